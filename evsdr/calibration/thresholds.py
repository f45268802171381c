"""Contrast thresholds of each pixel from a flicker of known waveform.

Between two events of a pixel log I changes by p C, from the end of the refractory period after the first to
the second. With log I(t) known, every pair is a measurement of C_on or C_off.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import h5py
import numpy as np

from evsdr.calibration import draw
from evsdr.calibration.flicker import HOT_HZ, Flicker, is_flicker, read_flicker
from evsdr.errors import InputError, InputWarning
from evsdr.events.pairs import pair_events
from evsdr.files.events_h5 import TOLERANCE, read_recording, write_recording
from evsdr.files.numbers import read_numbers
from evsdr.progress import Progress, silent
from evsdr.records import Recording, Schedule

WAVEFORMS = ("sine-log", "triangle-log", "sine", "triangle")
RING = "ring"  # the ring's own flicker, see `flicker`
OUTLIER = 4.0  # robust standard deviations of a pixel beyond which a pair does not count
LEAST_SPREAD = 0.02  # of a threshold: what may deviate without being an outlier
FEWEST_PAIRS = 5  # of one polarity in a pixel, for its own threshold
MOST_WRONG = 0.2  # of a pixel's pairs against the waveform: more has a hot pixel
RECEPTOR = 0.02  # of a threshold, by noise and lag of photoreceptors, which fire early and late; measured on an EVK4's
N_PHASE = 4096  # samples of a waveform


@dataclass(frozen=True)
class Thresholds:
    """Thresholds of one polarity.

    Attributes
    ----------
    value : (H, W) float32
        Contrast threshold; the median of the others where a pixel has too few pairs.
    sigma : (H, W) float32
        One standard deviation; the spread between pixels where a pixel has too few pairs.
    known : (H, W) bool
        Pixels with a threshold of their own.
    noise : float
        Relative standard deviation from one event to the next, median of the pixels.
    n_pair, n_wrong : int
        Pairs used, and pairs whose polarity contradicts the waveform.
    """

    value: np.ndarray
    sigma: np.ndarray
    known: np.ndarray
    noise: float
    n_pair: int
    n_wrong: int


def log_waveform(name: str, depth: float) -> np.ndarray:
    """Give log I at `N_PHASE` + 1 phases 0 .. 1 of a period.

    Parameters
    ----------
    name : str
        `sine-log`, `triangle-log`: of log I, which goes up and down by `depth` peak to peak. `sine`,
        `triangle`: of I, where `depth` is (max - min) / (max + min). Phase 0 is the middle of the rise.
        Or a CSV file of phase (0 .. 1) and intensity.
    depth : float
        Not used with a file.

    Raises
    ------
    InputError
        The waveform can't be used.
    """
    at = np.linspace(0, 1, N_PHASE + 1)
    if name not in WAVEFORMS:
        return _read_waveform(Path(name), at)
    if not 0 < depth < (np.inf if name.endswith("log") else 1):
        raise InputError(
            f"--depth is {depth:g}; give the change of log intensity from peak to peak, above 0, or for a "
            "waveform of the intensity itself the modulation, between 0 and 1."
        )
    wave = np.sin(2 * np.pi * at) if name.startswith("sine") else 1 - np.abs((4 * at + 1) % 4 - 2)
    return depth / 2 * wave if name.endswith("log") else np.log1p(depth * wave)


def _read_waveform(path: Path, at: np.ndarray) -> np.ndarray:
    names = ", ".join(WAVEFORMS)
    table = read_numbers(path, f"neither one of {names} nor a readable CSV file; name one")
    table = table[np.isfinite(table).all(axis=1)]  # a line of names
    if table.shape[1] != 2 or len(table) < 4 or (np.diff(table[:, 0]) <= 0).any():
        raise InputError(f"{path}: write two columns, growing phase and intensity, four lines or more.")
    if table[0, 0] < 0 or table[-1, 0] > 1 or table[:, 1].min() <= 0:
        raise InputError(f"{path}: phases go from 0 to 1 and intensities are above 0; correct the file.")
    return np.interp(at, table[:, 0], np.log(table[:, 1]), period=1.0)


def flicker_schedule(recording: Recording, period_us: float | None, start_us: float | None) -> Schedule:
    """Describe the flicker as a ring of one slot, so that triggers give its phase.

    Raises
    ------
    InputError
        Nothing says when the periods start.
    """
    round_us = recording.schedule.slot_us * len(recording.schedule.order)
    period = round_us if period_us is None else period_us
    if not 0 < period < np.inf:
        raise InputError(f"--period-us is {period:g}; give the period of the flicker in us, above 0.")
    if not len(recording.round_start_us) and start_us is None:
        raise InputError(
            "the recording has no trigger edges that mark the periods of the flicker; connect the "
            "trigger, or "
            "give the start of one period by --start-us."
        )
    start = recording.schedule.start_us if start_us is None else start_us
    return Schedule(np.zeros(1, np.int32), period, 1.0, start)


def measure_thresholds(
    recording: Recording, log_intensity: np.ndarray, schedule: Schedule
) -> tuple[Thresholds, Thresholds]:
    """Measure C_on and C_off of each pixel.

    Parameters
    ----------
    recording : Recording
        Under the flicker.
    log_intensity : (n,) float
        log I at even phases 0 .. 1.
    schedule : Schedule
        One slot, as `flicker_schedule` gives it.

    Returns
    -------
    on, off : Thresholds

    Raises
    ------
    InputError
        The events don't follow the waveform, or there are too few.
    """
    flicker = Recording(recording.events, recording.sensor, schedule, recording.round_start_us)
    pairs = pair_events(flicker)
    shape = (recording.sensor.height, recording.sensor.width)
    pixel = np.repeat(np.arange(shape[0] * shape[1]), np.diff(pairs.offset.astype(np.int64)))
    at = np.linspace(0, 1, len(log_intensity))
    change = np.interp(pairs.phase_end, at, log_intensity) - np.interp(pairs.phase_start, at, log_intensity)
    right = change * pairs.polarity > 0
    if right.mean() < 0.6:  # by chance it is a half
        raise InputError(
            f"{1 - right.mean():.0%} of the events have the polarity that the waveform forbids; check the "
            "waveform, the period, and that triggers mark the middle of its rise."
        )
    both = []
    for polarity, name in ((1, "ON"), (-1, "OFF")):
        of = pairs.polarity == polarity
        both.append(_average(pixel[of], np.where(right, np.abs(change), -1)[of], shape, name))
    return both[0], both[1]


def measure_ring_flicker(recording: Recording) -> tuple[Thresholds, Thresholds, Flicker]:
    """Measure C_on and C_off of each pixel from the ring's own flicker, whose depth is found; gives that too.

    Raises
    ------
    InputError
        It is no flicker, or there are too few events.
    """
    if not is_flicker(recording.schedule):
        raise InputError(
            "its schedule is not that of a flicker, an LED that fades in and out and then stays dark; record one by "
            "python -m evsdr.capture --flicker, or name another --waveform."
        )
    flicker, both = read_flicker(recording), []
    shape = (recording.sensor.height, recording.sensor.width)
    change = np.where(flicker.change * flicker.polarity > 0, np.abs(flicker.change), -1)
    still = (np.isfinite(flicker.veil) & (flicker.dark_hz < HOT_HZ)).reshape(shape)
    for polarity, name in ((1, "ON"), (-1, "OFF")):
        of = flicker.polarity == polarity
        one = _average(flicker.pixel[of], change[of], shape, name)
        known = one.known & still
        n = np.maximum(np.bincount(flicker.pixel[of], minlength=still.size), 1)
        by_veil = (np.bincount(flicker.pixel[of], flicker.left_open[of], still.size) / n).reshape(shape)
        sigma = np.sqrt(one.sigma**2 + by_veil**2 + (RECEPTOR * one.value) ** 2)
        value = np.where(known, one.value, np.median(one.value[known])) if known.any() else one.value
        both.append(replace(one, value=value.astype(np.float32), sigma=sigma.astype(np.float32), known=known))
    return both[0], both[1], flicker


def _average(pixel: np.ndarray, change: np.ndarray, shape: tuple[int, int], name: str) -> Thresholds:
    """Average each pixel's changes, without outliers from its median; -1 stands for the wrong polarity."""
    n_pixel = shape[0] * shape[1]
    n_wrong = np.bincount(pixel[change < 0], minlength=n_pixel)
    hot = n_wrong > MOST_WRONG * np.bincount(pixel, minlength=n_pixel)
    pixel, change = pixel[change >= 0], change[change >= 0]
    median = _median(pixel, change, n_pixel)
    spread = 1.4826 * _median(pixel, np.abs(change - median[pixel]), n_pixel)
    limit = np.maximum(OUTLIER * spread, LEAST_SPREAD * median)
    good = np.abs(change - median[pixel]) <= limit[pixel]
    pixel, change = pixel[good], change[good]
    n = np.bincount(pixel, minlength=n_pixel)
    mean = np.bincount(pixel, change, n_pixel) / np.maximum(n, 1)
    variance = np.bincount(pixel, (change - mean[pixel]) ** 2, n_pixel) / np.maximum(n - 1, 1)
    known = (n >= FEWEST_PAIRS) & ~hot
    if not known.any():
        raise InputError(
            f"no pixel has {FEWEST_PAIRS} {name} events that follow the waveform; "
            "record longer, or with a deeper flicker."
        )
    value = np.where(known, mean, np.median(mean[known]))
    between = np.std(mean[known]) if known.sum() > 1 else value[known][0]
    sigma = np.where(known, np.sqrt(variance / np.maximum(n, 1)), max(between, 1e-6))
    return Thresholds(
        value=value.reshape(shape).astype(np.float32),
        sigma=sigma.reshape(shape).astype(np.float32),
        known=known.reshape(shape),
        noise=float(np.median(np.sqrt(variance[known]) / mean[known])),
        n_pair=int(n.sum()),
        n_wrong=int(n_wrong.sum()),
    )


def _median(pixel: np.ndarray, value: np.ndarray, n_pixel: int) -> np.ndarray:
    """Give the median of each pixel's values; 0 where it has none."""
    order = np.lexsort((value, pixel))
    n = np.bincount(pixel, minlength=n_pixel)
    first = np.cumsum(n) - n
    value = np.append(value[order], 0.0)
    low, high = first + (n - 1) // 2, first + n // 2
    return np.where(
        n > 0, 0.5 * (value[np.minimum(low, len(value) - 1)] + value[np.minimum(high, len(value) - 1)]), 0
    )


def thresholds(
    folder: Path,
    events: Path,
    waveform: str = "sine-log",
    depth: float = 2.0,
    period_us: float | None = None,
    start_us: float | None = None,
    apply: Sequence[Path] = (),
    progress: Progress = silent,
) -> dict:
    """Measure thresholds per pixel.

    Parameters
    ----------
    folder : Path
        Gets thresholds.h5, residuals.png and the copies of recordings.
    events : Path
        Recording of the flicker, an events.h5.
    waveform : str
    depth : float
        See `log_waveform`.
    period_us, start_us : float, optional
        See `flicker_schedule`.
    apply : sequence of Path
        Recordings to copy with these thresholds.
    progress : callable (detail, share), optional
        Told how far it is.

    Returns
    -------
    dict
        Every estimate and its sigma, as calibration.json holds them.

    Raises
    ------
    InputError
        Something given can't be used, or the events don't tell.
    """
    for path in apply:
        if not path.is_file():
            raise InputError(f"{path}: there is no such file; name a recording.")
    recording = read_recording(events)
    progress("measure", 0.3)  # guessed, as the share below
    if waveform == RING:
        measure = partial(measure_ring_flicker, recording)
        period = recording.schedule.slot_us * len(recording.schedule.order)
    else:
        wave, schedule = log_waveform(waveform, depth), flicker_schedule(recording, period_us, start_us)
        measure, period = partial(measure_thresholds, recording, wave, schedule), schedule.slot_us
    try:
        on, off, *flickers = measure()
    except InputError as error:
        raise InputError(f"{events}: {error}") from error
    found = {"on": on, "off": off}
    with h5py.File(folder / "thresholds.h5", "w") as file:
        group = file.create_group("sensor")
        for name, one in found.items():
            group[f"contrast_threshold_{name}"] = one.value
            group[f"contrast_threshold_{name}_sigma"] = one.sigma
            group[f"contrast_threshold_{name}_known"] = one.known
            group.attrs[f"contrast_threshold_{name}"] = float(np.mean(one.value))
        tolerance = max(RECEPTOR, *(float(np.median(one.sigma / one.value)) for one in found.values()))
        group.attrs[TOLERANCE] = tolerance
        group.attrs["refractory_us"] = recording.sensor.refractory_us
    for k, path in enumerate(apply):
        progress(f"write {path.name}", 0.6 + 0.4 * k / len(apply))
        other = read_recording(path)
        if (other.sensor.width, other.sensor.height) != (recording.sensor.width, recording.sensor.height):
            raise InputError(f"{path}: its sensor region differs from that of {events}; record both alike.")
        values = {f"contrast_threshold_{name}": one.value for name, one in found.items()} | {
            TOLERANCE: tolerance
        }
        sensor = replace(other.sensor, **values)
        write_recording(folder / path.name, replace(other, sensor=sensor))
    draw.draw_thresholds(folder / "residuals.png", found)
    result = {"events": str(events), "waveform": waveform, "period_us": period}
    for flicker in flickers:
        result["flicker"] = _told_of(flicker)
    return result | {f"contrast_threshold_{name}": _summary(one) for name, one in found.items()}


def _summary(one: Thresholds) -> dict:
    """Give what calibration.json holds of a polarity."""
    known, value = one.known, one.value[one.known]
    return {
        "median": float(np.median(value)),
        "spread_between_pixels": float(np.std(value)),
        "sigma_of_a_pixel_median": float(np.median(one.sigma[known])),
        "relative_sigma_of_a_pixel_median": float(np.median(one.sigma[known] / value)),
        "relative_noise_from_event_to_event": one.noise,
        "pixels_known": int(known.sum()),
        "pixels": int(known.size),
        "pairs": one.n_pair,
        "pairs_against_the_waveform": one.n_wrong,
    }


def _told_of(flicker: Flicker) -> dict:
    """Give what calibration.json holds of the ring's flicker, and warn of lamps in the room."""
    for hz, share in flicker.mains.items():
        warnings.warn(
            InputWarning(
                f"{share:.0%} of the events in the dark come with a lamp of {hz:g} Hz in the room; switch it off."
            )
        )
    hot = flicker.dark_hz >= HOT_HZ
    return {
        "depth_of_log_intensity_median": float(np.nanmedian(np.log1p(1 / flicker.veil))),
        "pixels_whose_depth_is_known": int(np.isfinite(flicker.veil).sum()),
        "hot_pixels": np.flatnonzero(hot).tolist(),
        "events_in_the_dark_hz_median": float(np.median(flicker.dark_hz[~hot])) if not hot.all() else None,
        "room_flicker": {f"{hz:g}": share for hz, share in flicker.mains.items()},
    }
