"""Draw the distribution of z of each case beside that of true sigmas."""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from scipy import stats

from .compute import Row

BINS = np.linspace(0, 5, 26)
COLUMNS = 4


def draw(rows: list[Row], file: Path) -> None:
    """Draw a panel for each case: |z| of normals and of reflectance; what is beyond the axis is told in numbers."""
    n_row = -(-len(rows) // COLUMNS)
    size = 3 * COLUMNS, 1.9 * n_row + 0.4
    figure, panels = plt.subplots(
        n_row, COLUMNS, figsize=size, squeeze=False, sharex=True, layout="constrained"
    )
    z = np.linspace(0, BINS[-1], 200)
    expected = {"angle": 2 * z * np.exp(-(z**2)), "reflectance": 2 * stats.norm.pdf(z)}
    for axis, row in zip(panels.ravel(), rows):
        for name, colour in (("angle", "tab:blue"), ("reflectance", "tab:orange")):
            values = np.abs(row.z(name)).ravel()
            label = "normals" if name == "angle" else "reflectance"
            if len(values):
                density, _ = np.histogram(values, BINS)
                density = density / len(values) / np.diff(BINS)
                label += f", {np.mean(values > BINS[-1]):.0%} beyond"
                axis.stairs(density, BINS, color=colour, label=label)
            axis.plot(z, expected[name], color=colour, linestyle=":", linewidth=1)
        axis.set_title(row.name, fontsize=9)
        axis.set_ylim(0, 1.6)
        axis.legend(fontsize=6)
    for axis in panels.ravel()[len(rows) :]:
        axis.set_visible(False)
    figure.supxlabel("|error| / sigma; dotted: sigmas that are true", fontsize=9)
    figure.savefig(file, dpi=100)
    plt.close(figure)
