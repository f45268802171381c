"""A real ball: normals from events that its photographs would cause, beside least squares on the photographs.

Data: DiLiGenT, Shi et al., "A Benchmark Dataset and Evaluation for Non-Lambertian and Uncalibrated Photometric
Stereo", CVPR 2016; the object "ball", cropped.
"""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import evsdr
from evsdr import EventPixel, Maps, Schedule, Settings, Truth
from evsdr.files.photographs import Stack, write_scene

REPOSITORY = Path(__file__).resolve().parents[2]
MEDIAN_REFLECTANCE = 0.5  # assumed: the photographs don't tell their absolute scale
DARK = 0.05  # signal below which a photograph counts as shadowed, a tenth of what the ball gives
BRIGHTEST = 0.2  # share of a pixel's lit photographs that may hold its highlight
PAUSE = 4  # LEDs between two dark slots
SLOT_US, ROUNDS, CONSTANT_LIGHT = 20_000.0, 6, 0.05


@dataclass(frozen=True)
class Ball:
    """Photographs of a ball.

    Attributes
    ----------
    signal : (96, H, W) float64
        Grey value in units of a white patch that faces its light.
    light_direction : (96, 3) float64
        Unit vectors from surface to light; x right, y up, z toward the camera.
    normal : (H, W, 3) float32
        True normals, same frame.
    mask : (H, W) bool
        Where the ball is.
    """

    signal: np.ndarray
    light_direction: np.ndarray
    normal: np.ndarray
    mask: np.ndarray


@dataclass(frozen=True)
class Result:
    """What one method recovered.

    Attributes
    ----------
    method : str
        What was done.
    n_photograph : int
        Photographs used.
    normal : (H, W, 3) float
        Normals.
    reflectance : (H, W) float
        Reflectance of the grey band.
    event_rate : float
        Events per pixel of the ball and second; 0 where photographs were used as they are.
    """

    method: str
    n_photograph: int
    normal: np.ndarray
    reflectance: np.ndarray
    event_rate: float = 0.0


def data_path() -> Path:
    """Say where the photographs should be: in $EVSDR_DATA, else in ../shared/data beside the repository."""
    return Path(os.environ.get("EVSDR_DATA") or REPOSITORY.parent / "shared/data") / "diligent_ball_crop.npz"


def read_ball(path: Path) -> Ball:
    """Read the photographs: mean of the channels, each divided by its light's intensity.

    The scale is such that the median of the ball's reflectance is MEDIAN_REFLECTANCE, by least squares on the
    lights of the rim.
    """
    with np.load(path) as file:
        signal = np.mean(file["images"] / 65535 / file["light_int"][:, None, None], axis=-1)
        light, normal, mask = file["light_dir"], file["normal_gt"], file["mask"] != 0
    light = light / np.linalg.norm(light, axis=1, keepdims=True)
    rim = rim_order(light)
    _, reflectance = least_squares(signal[rim], light[rim])
    return Ball(signal * (MEDIAN_REFLECTANCE / np.median(reflectance[mask])), light, normal, mask)


def rim_order(light_direction: np.ndarray) -> np.ndarray:
    """Give the lights on the rim of the array, in order of azimuth from -180 degrees, counter-clockwise.

    The 96 lights hang in 12 columns of 8 and are listed column by column, from the middle to the left end, then
    from the middle to the right end. The rim is the top and bottom row and the two end columns: 36 lights, 26
    to 43 degrees off the axis, with gaps of 7 to 16 degrees in azimuth.
    """
    column, row = np.divmod(np.arange(96), 8)
    rim = np.flatnonzero((row == 0) | (row == 7) | (column == 5) | (column == 11))
    return rim[np.argsort(np.arctan2(light_direction[rim, 1], light_direction[rim, 0]))]


def least_squares(
    signal: np.ndarray, light_direction: np.ndarray, use: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Fit signal = reflectance * normal . light per pixel (Woodham 1980).

    Parameters
    ----------
    signal : (n_led, H, W) float
    light_direction : (n_led, 3) float
    use : (n_led, H, W) bool, optional
        Photographs that count in a pixel; all by default.

    Returns
    -------
    normal : (H, W, 3) float64
    reflectance : (H, W) float64
    """
    use = np.ones_like(signal) if use is None else use.astype(float)
    matrix = np.einsum("jyx,ji,jk->yxik", use, light_direction, light_direction)
    right = np.einsum("jyx,jyx,ji->yxi", use, signal, light_direction)
    scaled = np.linalg.solve(matrix, right[..., None])[..., 0]
    length = np.linalg.norm(scaled, axis=-1)
    return scaled / np.maximum(length, 1e-9)[..., None], length


def lit(signal: np.ndarray) -> np.ndarray:
    """Tell which photographs of a pixel are not shadowed; all where fewer than four are not."""
    bright = signal > DARK
    return bright | (bright.sum(axis=0) < 4)


def without_highlight(signal: np.ndarray) -> np.ndarray:
    """Tell which photographs of a pixel are lit and not among the brightest of these."""
    use = lit(signal)
    limit = np.nanquantile(np.where(use, signal, np.nan), 1 - BRIGHTEST, axis=0)
    use &= signal <= limit
    return use | (use.sum(axis=0) < 4)


def order_with_pauses(n_led: int) -> tuple[int, ...]:
    """Give the LEDs in turn, with a dark slot (-1) before every PAUSE of them."""
    return tuple(slot for j in range(n_led) for slot in ((-1, j) if j % PAUSE == 0 else (j,)))


def fit_events(ball: Ball, folder: Path, order: tuple[int, ...] | None, ideal: bool) -> tuple[Maps, float]:
    """Simulate the events that the photographs of the rim cause, and fit them.

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

    Returns
    -------
    maps : Maps
    event_rate : float
        Events per pixel of the ball and second.
    """
    rim = rim_order(ball.light_direction)
    grey = np.full((*ball.mask.shape, 1), MEDIAN_REFLECTANCE)
    stack = Stack(
        ball.signal[rim].astype(np.float32), ball.light_direction[rim], Truth(ball.normal, grey, ball.mask)
    )
    folder.mkdir(parents=True, exist_ok=True)
    write_scene(folder / "scene.xml", stack, CONSTANT_LIGHT)
    schedule = Schedule(np.array(order or range(len(rim)), np.int32), SLOT_US, 1.0)
    pixel = EventPixel().idealised() if ideal else EventPixel()
    recording = evsdr.record(stack.frames, CONSTANT_LIGHT, pixel, schedule, ROUNDS)
    matt = Settings(gloss="off")  # as least squares is
    found = evsdr.fit(folder / "scene.xml", recording, matt, ball.mask)
    seconds = 1e-6 * SLOT_US * ROUNDS * len(schedule.order)
    return found.maps, found.summary["numbers"]["events"] / np.count_nonzero(ball.mask) / seconds


def methods(ball: Ball, folder: Path) -> Iterator[Result]:
    """Run all methods, one after the other; recordings go to subfolders."""
    rim = rim_order(ball.light_direction)
    signal, light = ball.signal[rim], ball.light_direction[rim]
    yield Result(
        "least squares, all lights",
        len(ball.signal),
        *least_squares(ball.signal, ball.light_direction),
    )
    for note, use in (
        ("", None),
        (", lit", lit(signal)),
        (", lit, no highlight", without_highlight(signal)),
    ):
        yield Result(f"least squares{note}", len(rim), *least_squares(signal, light, use))
    for note, order in (("ring", None), ("dark slots", order_with_pauses(len(rim)))):
        for ideal in (True, False):
            pixel = "ideal" if ideal else "EVK4"
            maps, rate = fit_events(ball, folder / f"{note}_{pixel}".replace(" ", "_"), order, ideal)
            yield Result(f"events, {note}, {pixel}", len(rim), maps.normal, maps.reflectance[..., 0], rate)
