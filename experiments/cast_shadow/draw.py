"""Draw the normals and errors of each way, and the number of LEDs that are hidden, in truth and as found."""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from .compute import Result

LARGEST_DEG = 10.0  # of the colour scale
INCHES = 1.7  # of a map
DPI = 72  # keeps the file below 150 kB


def draw(results: list[Result], file: Path) -> None:
    """Draw a column for the truth and for each way, and last the hidden LEDs in truth above those found first."""
    n_column = len(results) + 2
    size = INCHES * n_column, 2 * INCHES + 0.6
    figure, axes = plt.subplots(2, n_column, figsize=size, layout="constrained")
    for axis in axes.flat:
        axis.axis("off")
    truth, hidden = results[0].truth, results[0].hidden
    _show(axes[0, 0], "truth", 0.5 * (truth.normal + 1), truth.mask[..., None])
    for (above, below), r in zip(axes.T[1:], results):
        title = f"{r.way}: {r.error_deg[r.known].mean():.2f}°"
        _show(above, title, 0.5 * (r.maps.normal + 1), r.known[..., None])
        angle = _show(below, "", r.error_deg, r.known, vmin=0, vmax=LARGEST_DEG, cmap="magma")
    figure.colorbar(angle, ax=axes[1, -2], label="angle [deg]")
    counts = {"hidden LEDs": hidden} | {f"as {r.way} finds": r.found for r in results if r.found is not None}
    for axis, (title, count) in zip(axes[:, -1], counts.items()):
        number = _show(axis, title, count, truth.mask, vmin=0, vmax=max(hidden.max(), 1))
    figure.colorbar(number, ax=axes[:, -1])
    figure.savefig(file, dpi=DPI)
    plt.close(figure)


def _show(axis, title: str, values: np.ndarray, mask: np.ndarray, **scale):
    """Show a map, white where it is masked; gives what a colour bar needs."""
    axis.set_title(title, fontsize=9)
    return axis.imshow(np.where(mask, values, np.nan if scale else 1), interpolation="nearest", **scale)
