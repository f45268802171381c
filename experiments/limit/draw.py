"""Draw error and limit against each parameter, for each scene."""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

AXES = {
    "constant light": "constant light $C_w$",
    "threshold": "contrast threshold",
    "noise": "event noise [%]",
    "rounds": "rounds",
}
COLOUR = {"bound": "0.35", False: "tab:blue", True: "tab:orange"}
LABEL = {"bound": "limit", False: "fit, each pixel alone", True: "fit with priors"}


def draw(rows: list[dict], base: dict[str, float], signal: dict[str, float], file: Path) -> None:
    """Draw a row of panels for each scene and a column for each parameter, first normals, then reflectance.

    Parameters
    ----------
    rows : list of dict
        Rows of `compute.run` with `parameter` and `value`.
    base : dict
        The parameters' values in the base case; one that varies otherwise has none.
    signal : dict
        Median LED signal of each scene, marked on the axis of the constant light.
    """
    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    height = 1.75 * 2 * len(scenes) + 1.2
    figure = plt.figure(figsize=(11, height), layout="constrained")
    halves = figure.subfigures(2, 1, hspace=0.02)
    for half, key, title in (
        (halves[0], "angle", "Normals: root mean square angle [deg]"),
        (halves[1], "reflectance", "Reflectance: root mean square error"),
    ):
        half.suptitle(title, fontsize=12, fontweight="bold")
        panels = half.subplots(len(scenes), len(AXES), sharex="col", sharey="row", squeeze=False)
        for axes, name in zip(panels, scenes):
            for axis, parameter in zip(axes, AXES):
                some = [row for row in rows if (row["scene"], row["parameter"]) == (name, parameter)]
                _curves(axis, some, key, parameter)
                if parameter in base:
                    axis.axvline(base[parameter], color="0.75", linewidth=1.5, zorder=1)
                if parameter == "constant light":
                    axis.axvline(signal[name], color="tab:green", linewidth=1.5, linestyle=":", zorder=1)
            axes[0].set_ylabel(name)
        for axis, label in zip(panels[-1], AXES.values()):
            axis.set_xlabel(label)
    lines = [
        plt.Line2D([], [], color=COLOUR[k], linestyle="--" if k == "bound" else "-", label=LABEL[k])
        for k in LABEL
    ]
    lines.append(plt.Line2D([], [], color="0.75", label="base case"))
    lines.append(plt.Line2D([], [], color="tab:green", linestyle=":", label="median LED signal"))
    lines.append(
        plt.Line2D(
            [], [], color="0.4", marker="o", ls="", mfc="white", label="under half of the pixels known"
        )
    )
    figure.legend(handles=lines, loc="outside upper center", ncols=3, frameon=False)
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=100)
    plt.close(figure)


def _curves(axis, rows: list[dict], key: str, parameter: str) -> None:
    scale = 100 if parameter == "noise" else 1
    rows = [row for row in rows if row[key] is not None]
    alone = [row for row in rows if not row["priors"]]
    axis.plot(
        [scale * row["value"] for row in alone],
        [row[f"{key}_bound"] for row in alone],
        "--",
        color=COLOUR["bound"],
    )
    for priors in (False, True):
        some = [row for row in rows if row["priors"] == priors]
        axis.plot(
            [scale * row["value"] for row in some],
            [row[key] for row in some],
            "-",
            color=COLOUR[priors],
            linewidth=1.2,
        )
        for row in some:
            full = row[f"{key}_known"] >= 0.5
            axis.plot(
                scale * row["value"],
                row[key],
                "o",
                color=COLOUR[priors],
                markerfacecolor=COLOUR[priors] if full else "white",
                markersize=4,
            )
    axis.set_yscale("log")
    if parameter != "noise":
        axis.set_xscale("log")
        axis.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.xaxis.set_minor_formatter(NullFormatter())
        axis.xaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
    axis.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.yaxis.set_minor_formatter(NullFormatter())
    axis.yaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
    axis.tick_params(labelsize=7)
    axis.grid(color="0.93")
