"""Draw the conventions: axes of camera and image, angles of an LED, and what the ring does over time."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

INK, ACCENT, PALE = "#24292f", "#0b6e99", "#d0d7de"
BANDS = ("#7b5cc4", "#3f6fd8", "#2d9a6b")


def draw(folder: Path) -> None:
    """Write axes.svg and schedule.svg into a folder, made if missing."""
    folder.mkdir(parents=True, exist_ok=True)
    figure = Figure(figsize=(10.5, 3.7), layout="constrained")
    image, front, side = figure.subplots(1, 3)
    draw_image(image)
    draw_ring(front)
    draw_side(side)
    figure.savefig(folder / "axes.svg", metadata={"Date": None})
    figure = Figure(figsize=(10.5, 3.4), layout="constrained")
    draw_schedule(figure.subplots())
    figure.savefig(folder / "schedule.svg", metadata={"Date": None})


def arrow(axis: Axes, start, end, text: str = "", colour: str = INK, shift=(0.0, 0.0)) -> None:
    """Draw an arrow with a word at its tip."""
    axis.annotate(
        "", end, start, arrowprops=dict(arrowstyle="-|>", color=colour, lw=1.8, shrinkA=0, shrinkB=0)
    )
    axis.text(end[0] + shift[0], end[1] + shift[1], text, color=colour, ha="center", va="center", fontsize=11)


def toward_us(axis: Axes, at, text: str, colour: str = INK) -> None:
    """Draw the tip of an arrow that comes out of the page."""
    axis.add_patch(Circle(at, 0.055, fill=False, color=colour, lw=1.6))
    axis.add_patch(Circle(at, 0.015, color=colour))
    axis.text(at[0] - 0.1, at[1] - 0.12, text, color=colour, ha="center", va="center", fontsize=11)


def draw_image(axis: Axes) -> None:
    """Draw pixels of an image with the axes of events and of normals."""
    axis.set_title("image and camera frame", fontsize=11)
    for k in range(9):
        axis.plot([k / 8, k / 8], [0, 1], color=PALE, lw=0.8)
        axis.plot([0, 1], [k / 8, k / 8], color=PALE, lw=0.8)
    axis.add_patch(Circle((0.5, 0.5), 0.4, color="#e8f1f6", zorder=0))
    axis.plot(1 / 16, 15 / 16, "s", color=ACCENT, ms=11)
    arrow(axis, (0, 1.08), (0.5, 1.08), "column x", ACCENT, (0.2, 0))
    arrow(axis, (-0.08, 1), (-0.08, 0.5), "row y", ACCENT, (0, -0.07))
    axis.text(0.15, 0.94, "pixel (0, 0)", color=ACCENT, fontsize=9, va="center")
    arrow(axis, (0.5, 0.5), (0.82, 0.5), "x", shift=(0.05, 0))
    arrow(axis, (0.5, 0.5), (0.5, 0.82), "y", shift=(0, 0.06))
    toward_us(axis, (0.5, 0.5), "z")
    axis.text(
        0.5,
        -0.1,
        "events count rows from the top;\nnormals have y up, z toward the camera",
        ha="center",
        va="top",
        fontsize=9,
    )
    finish(axis, (-0.2, 1.1), (-0.3, 1.16))


def draw_ring(axis: Axes) -> None:
    """Draw the ring as the camera sees it."""
    axis.set_title("ring, from the camera", fontsize=11)
    axis.add_patch(Circle((0, 0), 0.45, color="#e8f1f6"))
    for j in range(24):
        angle = np.deg2rad(15 * j)
        at = np.cos(angle), np.sin(angle)
        axis.plot(*at, "o", color=BANDS[j % 3], ms=7)
        if j in (0, 1, 2, 6, 12, 18, 23):
            axis.text(1.17 * at[0], 1.17 * at[1], str(j), ha="center", va="center", fontsize=9, color=INK)
    turn = np.deg2rad(np.linspace(0, 60, 30))
    axis.plot(0.72 * np.cos(turn), 0.72 * np.sin(turn), color=ACCENT, lw=1.5)
    axis.plot([0, np.cos(turn[-1])], [0, np.sin(turn[-1])], color=ACCENT, lw=1, ls=":")
    axis.text(0.36, 0.2, "azimuth", color=ACCENT, fontsize=9, ha="center", va="center")
    arrow(axis, (0, 0), (0.62, 0), "x", shift=(0.09, 0))
    arrow(axis, (0, 0), (0, 0.62), "y", shift=(0, 0.1))
    toward_us(axis, (0, 0), "z")
    axis.text(
        0,
        -1.32,
        "LED j of the example rigs: azimuth 15° · j,\n0° is right, 90° is up",
        ha="center",
        va="top",
        fontsize=9,
    )
    finish(axis, (-1.35, 1.35), (-1.7, 1.25))


def draw_side(axis: Axes) -> None:
    """Draw object, camera and one LED from the side."""
    axis.set_title("from the side", fontsize=11)
    axis.add_patch(Circle((0, 0), 0.3, color="#e8f1f6"))
    arrow(axis, (0, 0), (1.5, 0), "z", shift=(0.0, -0.12))
    axis.plot([1.62, 1.86, 1.86, 1.62, 1.62], [-0.12, -0.12, 0.12, 0.12, -0.12], color=INK, lw=1.6)
    axis.text(1.74, -0.26, "camera", ha="center", va="center", fontsize=9)
    led = np.array([0.95, 0.95])
    axis.plot(*led, "o", color=BANDS[0], ms=10)
    axis.text(led[0] + 0.12, led[1] + 0.1, "LED j", fontsize=9)
    arrow(axis, (0, 0), 0.92 * led, "l", BANDS[0], (-0.28, -0.16))
    tilt = np.deg2rad(np.linspace(0, 45, 20))
    axis.plot(0.6 * np.cos(tilt), 0.6 * np.sin(tilt), color=ACCENT, lw=1.5)
    axis.text(0.78, 0.26, "polar angle", color=ACCENT, fontsize=9)
    normal = np.array([np.cos(np.deg2rad(75)), np.sin(np.deg2rad(75))])
    arrow(axis, 0.3 * normal, 0.85 * normal, "n", INK, (0.0, 0.1))
    axis.text(
        0.8,
        -0.62,
        "l points from the surface to the LED;\nn has unit length and $n_z > 0$",
        ha="center",
        va="top",
        fontsize=9,
    )
    finish(axis, (-0.55, 2.05), (-1.15, 1.35))


def draw_schedule(axis: Axes) -> None:
    """Draw weights of LEDs over one round with a dark slot, and the triggers."""
    order, crossfade = (0, 1, -1, 2), 0.5
    n = len(order)
    time = np.linspace(0, n, 1601)
    slot = np.minimum(time.astype(int), n - 1)
    fade = np.clip((time - slot - (1 - crossfade)) / crossfade, 0, 1)
    after = np.roll(order, -1)
    for j, colour in enumerate(BANDS):
        weight = (1 - fade) * (np.array(order)[slot] == j) + fade * (after[slot] == j)
        axis.fill_between(time, weight, color=colour, alpha=0.18, lw=0)
        axis.plot(time, weight, color=colour, lw=1.8, label=f"$w_{j}(t)$")
    for k in range(n + 1):
        axis.axvline(k, color=PALE, lw=0.8, zorder=0)
        if k < n:
            axis.text(k + 0.5, -0.14, f"order[{k}] = {order[k]}", ha="center", fontsize=9)
    for at in (0, n):
        arrow(axis, (at, 1.45), (at, 1.1), "trigger, p = 1", ACCENT, (0.0, 0.44))
    axis.annotate("", (1, 1.18), (0, 1.18), arrowprops=dict(arrowstyle="<->", color=INK))
    axis.text(0.5, 1.24, "slot_us", ha="center", fontsize=10)
    axis.annotate("", (2, 1.18), (1.5, 1.18), arrowprops=dict(arrowstyle="<->", color=INK))
    axis.text(1.75, 1.24, "crossfade · slot_us", ha="center", fontsize=10)
    axis.text(2.25, 0.5, "dark slot:\nonly $C_w$", ha="center", va="center", fontsize=9)
    axis.legend(loc="center right", frameon=False, fontsize=10, bbox_to_anchor=(1.12, 0.5))
    finish(axis, (-0.35, 4.6), (-0.3, 1.7), "auto")


def finish(axis: Axes, x: tuple, y: tuple, aspect: str = "equal") -> None:
    """Set what is seen; no frame."""
    axis.set(xlim=x, ylim=y)
    axis.set_aspect(aspect)
    axis.axis("off")
