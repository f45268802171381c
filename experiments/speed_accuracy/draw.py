"""Draw errors against seconds and memory."""

from pathlib import Path

import numpy as np

from .compute import Result

NEAR = 0.07  # of the extent of all points, within which they share a label; chosen by eye


def draw(path: Path, results: list[Result]) -> None:
    """Draw a point for each fit, a line through those of a size that no other beats in both."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    figure = Figure(figsize=(10, 5), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    ways = list(dict.fromkeys(result.way for result in results))
    sizes = sorted({result.size for result in results})
    for axis, name, unit in zip(axes, ("seconds", "memory"), ("s, all in all", "MiB, peak"), strict=True):
        for k, size in enumerate(sizes):
            of = [result for result in results if result.size == size]
            points = [(getattr(result, name), result.errors["mae_deg"]) for result in of]
            axis.plot(*zip(*points, strict=True), ".", color=f"C{k}")
            axis.plot(*zip(*front(points), strict=True), color=f"C{k}", lw=1, label=f"{size} x {size}")
            for group in together(points):
                label = ", ".join(str(ways.index(of[i].way) + 1) for i in group)
                (_, low), (right, high) = (f([points[i] for i in group], axis=0) for f in (np.min, np.max))
                few = len(group) < 3
                place, offset, side = (
                    ((right, high), (4, 4), "left") if few else ((right, low), (10, -14), "right")
                )
                look = {"textcoords": "offset points", "ha": side, "color": f"C{k}", "fontsize": 8}
                axis.annotate(label, place, offset, **look)
        axis.set(xscale="log", yscale="log", xlabel=f"{name} [{unit}]")
        axis.grid(alpha=0.3)
        axis.margins(0.12)
        for side in axis.xaxis, axis.yaxis:
            side.set_major_locator(LogLocator(subs=(1, 2, 5)))
            side.set_major_formatter(StrMethodFormatter("{x:g}"))
            side.set_minor_formatter(NullFormatter())
    axes[0].set_ylabel("mean angle [deg]")
    axes[1].legend(fontsize=8)
    half = -(-len(ways) // 2)
    words = [f"{n} {way}" for n, way in enumerate(ways, 1)]
    figure.supxlabel("\n".join("   ".join(line) for line in (words[:half], words[half:])), fontsize=8)
    figure.savefig(path, dpi=120)


def front(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Give the points that no other beats in both coordinates (Pareto), by the first."""
    out: list[tuple[float, float]] = []
    for point in sorted(points):
        if not out or point[1] < out[-1][1]:
            out.append(point)
    return out


def together(points: list[tuple[float, float]]) -> list[list[int]]:
    """Group points so close to the first of their group that labels would overlap; gives their indices."""
    groups: list[list[int]] = []
    place = np.log(points)
    reach = NEAR * np.ptp(place, axis=0)
    for i, point in enumerate(place):
        near = (g for g in groups if (np.abs(point - place[g[0]]) <= reach).all())
        group = next(near, None)
        if group is None:
            groups.append([i])
        else:
            group.append(i)
    return groups
