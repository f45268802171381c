"""Draw the normals and error maps of each way, with the outline of the shadow."""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from .compute import Result

LARGEST_DEG, LARGEST_RMS = 10.0, 0.1  # of the colour scales


def draw(results: list[Result], file: Path) -> None:
    """Draw a column for each way: normals, angular error, error of the reflectance."""
    figure, axes = plt.subplots(3, len(results), figsize=(2.4 * len(results), 7), layout="constrained")
    for column, r in zip(axes.T, results):
        mask = r.inside | r.outside
        column[0].imshow(np.where(mask[..., None], 0.5 * (r.maps.normal + 1), 1))
        column[0].set_title(f"{r.way}: {r.error_deg[mask].mean():.2f}°, {r.rms[mask].mean():.3f}", fontsize=9)
        angle = column[1].imshow(np.where(mask, r.error_deg, np.nan), vmin=0, vmax=LARGEST_DEG, cmap="magma")
        rms = column[2].imshow(np.where(mask, r.rms, np.nan), vmin=0, vmax=LARGEST_RMS, cmap="magma")
        for axis in column:
            axis.contour(r.inside, [0.5], colors="cyan", linewidths=0.3)
            axis.axis("off")
    figure.colorbar(angle, ax=axes[1], label="angle [deg]")
    figure.colorbar(rms, ax=axes[2], label="reflectance, RMS over bands")
    figure.savefig(file, dpi=73)
    plt.close(figure)
