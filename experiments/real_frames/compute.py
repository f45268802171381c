"""Normals from events that frames of a thing would cause, beside least squares on the frames."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import evsdr
from evsdr import EventPixel, Maps, Schedule, Settings, Truth
from evsdr.files.photographs import Stack, write_scene

from .objects import MEDIAN_REFLECTANCE, Frames, least_squares

DARK = 0.05  # signal below which a frame counts as shadowed, a tenth of what the object gives
BRIGHTEST = 0.2  # share of a pixel's lit frames that may hold its highlight
PAUSE = 4  # LEDs between two dark slots
SLOT_US, ROUNDS, CONSTANT_LIGHT = 20_000.0, 6, 0.05
SWEEPS, SMALLEST = 60, 1e-4  # of the fit of least absolute values, and residual that counts as none


@dataclass(frozen=True)
class Result:
    """What one method recovered.

    Attributes
    ----------
    method : str
        What was done.
    n_frame : int
        Frames used.
    normal : (H, W, 3) float
        Normals.
    reflectance : (H, W) float
        Reflectance of the grey band.
    event_rate : float
        Events per pixel of the object and second; 0 where frames were used as they are.
    """

    method: str
    n_frame: int
    normal: np.ndarray
    reflectance: np.ndarray
    event_rate: float = 0.0


def lit(signal: np.ndarray) -> np.ndarray:
    """Tell which frames of a pixel are not shadowed; all where fewer than four are not."""
    bright = signal > DARK
    return bright | (bright.sum(axis=0) < 4)


def without_highlight(signal: np.ndarray) -> np.ndarray:
    """Tell which frames of a pixel are lit and not among the brightest of these."""
    use = lit(signal)
    limit = np.nanquantile(np.where(use, signal, np.nan), 1 - BRIGHTEST, axis=0)
    use &= signal <= limit
    return use | (use.sum(axis=0) < 4)


def least_absolute(signal: np.ndarray, light_direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Fit as `least_squares`, but the sum of absolute residuals: "L1" of Ikehata et al. 2012, by reweighting."""
    normal, reflectance = least_squares(signal, light_direction)
    for _ in range(SWEEPS):
        shaded = reflectance * np.einsum("jk,yxk->jyx", light_direction, normal)
        weight = 1 / np.maximum(np.abs(signal - shaded), SMALLEST)
        normal, reflectance = least_squares(signal, light_direction, weight)
    return normal, reflectance


def order_with_pauses(n_led: int) -> tuple[int, ...]:
    """Give the LEDs in turn, with a dark slot (-1) before every PAUSE of them."""
    return tuple(slot for j in range(n_led) for slot in ((-1, j) if j % PAUSE == 0 else (j,)))


def fit_events(
    frames: Frames, folder: Path, order: tuple[int, ...] | None, ideal: bool, gloss: str = "off"
) -> tuple[Maps, float]:
    """Simulate the events that the frames of the ring cause, and fit them.

    As `python -m evsdr.simulate --frames stack.npz [--order ...] [--ideal]` and `python -m evsdr.fit scene.xml
    events.h5 --mask mask.npy --gloss off` do.

    Parameters
    ----------
    folder : Path
        For the scene.
    order : tuple of int, optional
        LED of each slot, -1 for none; by default each in turn.
    ideal : bool
        Leave out what is not ideal in the event pixel.
    gloss : str
        What the fit is asked of gloss; off, it is as matt as least squares is.

    Returns
    -------
    maps : Maps
    event_rate : float
        Events per pixel of the object and second.
    """
    ring = frames.ring
    grey = np.full((*frames.mask.shape, 1), MEDIAN_REFLECTANCE)
    truth = Truth(frames.normal, grey, frames.mask)
    stack = Stack(frames.signal[ring].astype(np.float32), frames.light_direction[ring], truth)
    folder.mkdir(parents=True, exist_ok=True)
    write_scene(folder / "scene.xml", stack, CONSTANT_LIGHT)
    schedule = Schedule(np.array(order or range(len(ring)), np.int32), SLOT_US, 1.0)
    pixel = EventPixel().idealised() if ideal else EventPixel()
    recording = evsdr.record(stack.frames, CONSTANT_LIGHT, pixel, schedule, ROUNDS)
    found = evsdr.fit(folder / "scene.xml", recording, Settings(gloss=gloss), frames.mask)
    seconds = 1e-6 * SLOT_US * ROUNDS * len(schedule.order)
    return found.maps, found.summary["numbers"]["events"] / np.count_nonzero(frames.mask) / seconds


def methods(frames: Frames, folder: Path) -> Iterator[Result]:
    """Run all methods, one after the other; scenes go to subfolders."""
    ring = frames.ring
    signal, light = frames.signal[ring], frames.light_direction[ring]
    whole = least_squares(frames.signal, frames.light_direction)
    yield Result("least squares, all lights", len(frames.signal), *whole)
    for note, use in (
        ("", None),
        (", lit", lit(signal)),
        (", lit, no highlight", without_highlight(signal)),
    ):
        yield Result(f"least squares{note}", len(ring), *least_squares(signal, light, use))
    yield Result("least absolute values", len(ring), *least_absolute(signal, light))
    pauses = order_with_pauses(len(ring))
    for name, order, ideal, gloss in (
        ("ring, ideal", None, True, "off"),
        ("ring, EVK4", None, False, "off"),
        ("dark slots, ideal", pauses, True, "off"),
        ("dark slots, EVK4", pauses, False, "off"),
        ("dark slots, EVK4, gloss", pauses, False, "auto"),
    ):
        maps, rate = fit_events(frames, folder / name.replace(", ", "_"), order, ideal, gloss)
        yield Result(f"events, {name}", len(ring), maps.normal, maps.reflectance[..., 0], rate)
