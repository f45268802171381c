"""Draw errors against seconds and memory."""

from pathlib import Path

from .compute import Result


def draw(path: Path, results: list[Result]) -> None:
    """Draw a point for each fit, a line through those of a size that no other beats in both."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 4.5), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    ways = list(dict.fromkeys(result.way for result in results))
    sizes = sorted({result.size for result in results})
    for axis, name, unit in zip(axes, ("seconds", "memory"), ("s, all in all", "MiB, peak"), strict=True):
        for k, size in enumerate(sizes):
            of = [result for result in results if result.size == size]
            best = front([(getattr(result, name), result.errors["mae_deg"]) for result in of])
            axis.plot(*zip(*best, strict=True), color=f"C{k}", lw=1, label=f"{size} x {size}")
            for result in of:
                at = getattr(result, name), result.errors["mae_deg"]
                axis.plot(*at, marker=f"${ways.index(result.way) + 1}$", color=f"C{k}", ms=8)
        axis.set(xscale="log", yscale="log", xlabel=f"{name} [{unit}]")
    axes[0].set_ylabel("mean angle [deg]")
    axes[1].legend(fontsize=7)
    figure.supxlabel("   ".join(f"{n} {way}" for n, way in enumerate(ways, 1)), fontsize=6)
    figure.savefig(path, dpi=120)


def front(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Give the points that no other beats in both coordinates (Pareto), by the first."""
    out: list[tuple[float, float]] = []
    for point in sorted(points):
        if not out or point[1] < out[-1][1]:
            out.append(point)
    return out
