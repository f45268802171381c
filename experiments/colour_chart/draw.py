"""Draw the chart in colour, true and recovered, and where its reflectance errs."""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from evsdr.files.daylight import reflectance_to_srgb

from .compute import Chart

LARGEST = 0.1  # of the colour scale


def draw(charts: dict[str, Chart], file: Path) -> None:
    """Draw true colours, those recovered, events and errors, one row per chart.

    Parameters
    ----------
    charts : dict
        Charts by title.
    file : Path
        The picture to write.
    """
    first = next(iter(charts.values()))
    wavelength = first.maps.band_wavelength_nm
    figure, axes = plt.subplots(
        len(charts), 4, figsize=(12, 2.3 * len(charts)), layout="constrained", squeeze=False
    )
    y, x = (np.flatnonzero(first.truth.mask.any(axis=k)) for k in (1, 0))
    for row, (title, chart) in zip(axes, charts.items()):
        outside = ~chart.truth.mask
        for axis, name, maps in ((row[0], "true", chart.truth), (row[1], title, chart.maps)):
            colour = reflectance_to_srgb(maps.reflectance, wavelength)
            axis.imshow(np.where(outside[..., None], 1, colour))
            axis.set_title(name)
        image = row[2].imshow(np.where(outside, np.nan, chart.n_event), cmap="viridis")
        row[2].set_title("events of a pixel")
        figure.colorbar(image, ax=row[2], shrink=0.8)
        error = np.sqrt(np.mean((chart.maps.reflectance - chart.truth.reflectance) ** 2, axis=-1))
        image = row[3].imshow(np.where(outside, np.nan, error), vmin=0, vmax=LARGEST, cmap="magma")
        row[3].set_title(f"error, mean {error[~outside].mean():.4f}")
        figure.colorbar(image, ax=row[3], shrink=0.8, extend="max")
    for axis in axes.ravel():
        axis.title.set_fontsize(10)
        axis.axis("off")
        axis.set(xlim=(x[0] - 2, x[-1] + 2), ylim=(y[-1] + 2, y[0] - 2))
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=100)
    plt.close(figure)
