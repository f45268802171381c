"""Whether what was asked of a fit, its scene and its recording go together."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from evsdr.errors import InputError, check_address_space, check_memory
from evsdr.events.chosen import count_events
from evsdr.files.mask import read_mask
from evsdr.fitting.settings import Settings
from evsdr.light.checks import check_film, check_object
from evsdr.light.scene import RingScene
from evsdr.records import Recording
from evsdr.threads import side_by_side

MAX_BANDS = 40  # of the per-pixel systems
FIT_BYTES, EVENT_BYTES = 130 << 20, 280  # of memory, and more for each event; measured, see docs/presets.md
# Of address space beside: of kernels, and of each thread's heap and stack; Dr.Jit keeps what it has freed. All measured
RESERVED, THREAD_BYTES, KEPT = 80 << 20, 72 << 20, 2
THRESHOLDS = (1e-3, 10.0)  # of natural log intensity, outside of which no event pixel is


def check_fit(ring: RingScene, recording: Recording, settings: Settings) -> None:
    """Check that scene and recording belong together."""
    check_film(ring, recording)
    for name in ("contrast_threshold_on", "contrast_threshold_off"):
        threshold = np.asarray(getattr(recording.sensor, name))
        if threshold.min() < THRESHOLDS[0] or threshold.max() > THRESHOLDS[1]:
            raise InputError(
                f"{recording.source}: {name} goes from {threshold.min():g} to {threshold.max():g}; "
                "write changes of natural log intensity, as 0.25."
            )
    unknown = int(np.max(recording.schedule.order))
    if unknown >= ring.leds.n_led:
        raise InputError(
            f"{recording.source}: schedule/order lights LED {unknown}, but {ring.path} has only "
            f"{ring.leds.n_led} LEDs, numbered from 0; mend order or add the emitter."
        )
    if settings.solver == "lm" and ring.leds.n_band > MAX_BANDS:
        raise InputError(
            f"{ring.path}: {ring.leds.n_band} bands are too many for the solver lm, which takes {MAX_BANDS}; "
            "use --solver adam."
        )


def as_recorded(ring: RingScene, recording: Recording) -> tuple[RingScene, Recording]:
    """Give scene and recording with LEDs as bright as they were; those that were dark are none."""
    schedule, trim = recording.schedule, recording.schedule.trim
    if schedule.constant_light_on is not None and schedule.constant_light_on != (ring.constant_light > 0):
        state, mend = ("on", "above 0") if schedule.constant_light_on else ("off", "0")
        raise InputError(
            f"{recording.source}: its constant light was {state} but {ring.path} has a constant_light of "
            f"{ring.constant_light:g}; make it {mend}, or convert with --lamp own if the light was not the ring's."
        )
    if trim is None:
        return ring, recording
    trim = np.asarray(trim, float)
    if len(trim) < ring.leds.n_led or not ((trim >= 0) & (trim <= 1)).all():
        raise InputError(
            f"{recording.source}: schedule/trim must hold {ring.leds.n_led} numbers from 0 to 1, one for each LED of "
            f"{ring.path}; correct it."
        )
    lit = np.append(trim, 1) > 0  # the last for none
    order = np.where(lit[schedule.order], schedule.order, -1).astype(np.int32)
    if order.max() < 0:
        raise InputError(f"{recording.source}: schedule/trim is 0 for all LEDs of order; correct it.")
    recording = replace(recording, schedule=replace(schedule, order=order, trim=None))
    trim = trim[: ring.leds.n_led]
    return ring.trimmed(np.where(trim > 0, trim, 1)) if (trim[trim > 0] != 1).any() else ring, recording


def object_mask(ring: RingScene, coverage: np.ndarray, wanted: np.ndarray | str | Path | None) -> np.ndarray:
    """Give the pixels to solve: those that the object covers and the user's mask, an array or a file, holds."""
    mask = coverage >= 0.5
    check_object(ring, mask)
    if wanted is None:
        return mask
    if isinstance(wanted, str | Path):
        source, wanted = wanted, read_mask(Path(wanted), mask.shape)
    else:
        source, wanted = "the mask", np.asarray(wanted)
    if wanted.shape != mask.shape:
        raise InputError(f"{source} has shape {wanted.shape}; it must be (height, width) = {mask.shape}.")
    mask &= wanted != 0
    if not mask.any():
        raise InputError(f"{source}: the mask has no pixel of the object; draw it over the object.")
    return mask


def check_room(recording: Recording, mask: np.ndarray) -> None:
    """Refuse a fit that needs more memory than is free: by the events of its pixels."""
    n_event = int(count_events(recording.events, mask.shape)[mask].sum())
    what, n_bytes = f"{recording.source}: a fit of {n_event} events", EVENT_BYTES * n_event
    check_address_space(what, FIT_BYTES + KEPT * n_bytes + RESERVED + THREAD_BYTES * side_by_side())
    check_memory(what, FIT_BYTES + n_bytes, "fit fewer pixels (--mask) or rounds, or close other programs")
