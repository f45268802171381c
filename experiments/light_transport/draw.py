"""Draw the errors of each way as bars."""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

from .compute import Result

COLOUR = "0.6", "tab:blue", "tab:orange"  # without, with, auto


def draw(found: list[tuple[str, list[Result]]], file: Path) -> None:
    """Draw a group of bars for each case: without the effect, with it, and as `auto` decides."""
    figure, axis = plt.subplots(figsize=(1.7 * len(found), 3.5), layout="constrained")
    for i, (_, results) in enumerate(found):
        for k, (r, colour) in enumerate(zip(results, COLOUR)):
            label = ("without", "with", "auto")[k] if i == 0 else None
            axis.bar(i + 0.27 * (k - 1), r.mae_deg, 0.25, color=colour, label=label)
    axis.set_xticks(range(len(found)), [name for name, _ in found], fontsize=7)
    axis.set_yscale("log")
    axis.set_ylabel("mean angle [deg]")
    axis.legend()
    figure.savefig(file, dpi=110)
    plt.close(figure)
