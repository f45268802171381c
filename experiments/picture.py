"""`python -m experiments.picture DIR truth.npz picture.png`: show what a fit recovered, and how well.

Normals, colour under daylight, the eight bands, and the two error maps beside each other.
"""

import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from evsdr import angular_error_deg
from evsdr.files.daylight import reflectance_to_srgb

WITHIN = 0.99  # of the pixels lie within the scale of an error


def draw(folder: Path, truth_path: Path, picture: Path) -> None:
    """Draw the maps of a fit beside their errors."""
    maps, truth = np.load(folder / "maps.npz"), np.load(truth_path)
    mask, known = truth["mask"], maps["mask"]
    angle = np.where(mask, angular_error_deg(maps["normal"], truth["normal"]), np.nan)
    rmse = np.sqrt(np.mean((maps["reflectance"] - truth["reflectance"]) ** 2, axis=-1))
    rmse = np.where(mask, rmse, np.nan)
    colour = reflectance_to_srgb(maps["reflectance"], maps["band_wavelength_nm"])
    normal = 0.5 * (maps["normal"] + 1)

    figure = plt.figure(figsize=(12, 4.4), layout="constrained")
    left, right = figure.subfigures(1, 2, width_ratios=(2.9, 1))
    top, bottom = left.subfigures(2, 1, height_ratios=(1.9, 1))
    axes = top.subplots(1, 4)
    white = ~known[..., None]
    axes[0].imshow(np.where(white, 1, normal))
    axes[0].set_title("surface normal")
    axes[1].imshow(np.where(white, 1, colour))
    axes[1].set_title("reflectance, D65")
    for axis, error, title in (
        (axes[2], angle, f"angle: {np.nanmean(angle):.2f}° mean"),
        (axes[3], rmse, f"reflectance: {np.nanmean(rmse):.3f} RMSE"),
    ):
        image = axis.imshow(error, vmin=0, vmax=np.nanquantile(error, WITHIN), cmap="magma")
        axis.set_title(title)
        top.colorbar(image, ax=axis, shrink=0.7, extend="max")
    for b, axis in enumerate(bottom.subplots(1, maps["reflectance"].shape[-1], squeeze=False)[0]):
        band = np.where(known, maps["reflectance"][..., b], np.nan)
        axis.imshow(band, vmin=0, vmax=1, cmap="gray")
        axis.set_title(f"{maps['band_wavelength_nm'][b]:.0f} nm", fontsize=9)
        axes = [*axes, axis]
    for axis in axes:
        axis.axis("off")

    plot = right.subplots()
    rows, columns = np.nonzero(mask & known)
    for i in np.linspace(0, len(rows) - 1, 7).astype(int)[1:-1]:
        at = rows[i], columns[i]
        line = plot.errorbar(
            maps["band_wavelength_nm"], maps["reflectance"][at], maps["reflectance_sigma"][at], fmt="o", ms=3
        )
        plot.plot(maps["band_wavelength_nm"], truth["reflectance"][at], color=line[0].get_color())
    plot.set(xlabel="wavelength [nm]", ylim=(0, 1), title="five pixels: lines are true")
    figure.savefig(picture, dpi=90)
    plt.close(figure)


if __name__ == "__main__":
    draw(*map(Path, sys.argv[1:4]))
