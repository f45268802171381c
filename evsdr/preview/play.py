"""A recording from its file to maps, a picture and figures."""

import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np

from evsdr.errors import InputWarning
from evsdr.files.atomic import atomic_path
from evsdr.files.results import encode_normal, write_png
from evsdr.fitting.entrance import fit
from evsdr.fitting.settings import Settings
from evsdr.metrics import angular_error_deg, score
from evsdr.preview.decoder import Decoder, Light, light_of
from evsdr.preview.replay import Frame, replay, times
from evsdr.records import Recording, Truth

Rows = list[tuple[str, str]]


def prepare(ring, recording: Recording) -> tuple[Recording, Light]:
    """Check that scene and recording belong together, and trace what the LEDs send to the pixels."""
    from evsdr.fitting.checks import as_recorded, check_fit, object_mask  # late: they need Mitsuba
    from evsdr.light.tracing import trace_illumination

    check_fit(ring, recording, Settings(preset="fast"))
    ring, recording = as_recorded(ring, recording)
    illumination, coverage = trace_illumination(ring, 1, shadows=ring.shape_is_known)
    return recording, light_of(illumination, object_mask(ring, coverage, None))


def play_all(
    recording: Recording,
    light: Light,
    rounds: float,
    maps_hz: float,
    realtime: bool,
    out: Path,
    told: Callable[[str, float], object],
) -> list[Frame]:
    """Make all maps; each replaces the picture if they come at the recording's own speed, else the last is written.

    See `replay`; `told` is told which share is done.
    """
    end_us = times(recording, rounds, maps_hz)
    frames = []
    for frame in replay(recording, Decoder(light, recording), light.mask, rounds, end_us, realtime):
        frames.append(frame)
        if realtime or frame.end_us == end_us[-1]:
            with atomic_path(out) as temporary:
                write_png(temporary, (encode_normal(frame.normal, frame.known) >> 8).astype(np.uint8))
        told("", len(frames) / len(end_us))
    return frames


def speed_rows(frames: list[Frame]) -> Rows:
    """Say how fast maps were; the first, which starts from nothing and compiles, stands by itself."""
    steady = frames[1:] or frames
    seconds, cpu = (np.mean([getattr(f, name) for f in steady]) for name in ("seconds", "cpu_seconds"))
    return [
        ("maps", str(len(frames))),
        ("first map [s]", f"{frames[0].seconds:.2f}"),
        ("maps a second", f"{1 / seconds:.1f}"),
        ("time of all cores for a map [ms]", f"{1e3 * cpu:.1f}"),
        ("known pixels", f"{np.count_nonzero(frames[-1].known)}"),
    ]


def error_rows(frame: Frame, truth: Truth) -> Rows:
    """Say how far a map is from the truth, where both are known."""
    error = angular_error_deg(frame.normal, truth.normal)[truth.mask & frame.known]
    if not len(error):
        return []
    return [("mae_deg", f"{error.mean():.4f}"), ("median_deg", f"{np.median(error):.4f}")]


def fast_rows(ring, recording: Recording, truth: Truth) -> Rows:
    """Fit preset fast to the whole recording, and say how far it is from the truth."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        found = score(fit(ring, recording, Settings(preset="fast")).maps, truth)
    return [(f"fast: {name}", f"{found[name]:.4f}") for name in ("mae_deg", "median_deg")]
