"""Whether what was asked of a fit, its scene and its recording go together."""

import numpy as np

from evsdr.errors import InputError
from evsdr.files.mask import read_mask
from evsdr.records import Recording

PRIORS = ("normal", "integrable", "reflectance", "spectra")
MAX_BANDS = 40  # of the per-pixel systems
THRESHOLDS = (1e-3, 10.0)  # of natural log intensity, outside of which no event pixel is


def parse_priors(text: str) -> tuple[str, ...]:
    """Read the names of priors."""
    names = tuple(name.strip() for name in text.split(",")) if text != "none" else ()
    for name in names:
        if name not in PRIORS:
            raise InputError(
                f"--priors {text}: there is no {name!r}; name some of {', '.join(PRIORS)}, or none."
            )
    return names


def check_fit(ring, recording: Recording, options) -> None:
    """Check that scene and recording belong together."""
    size = (recording.sensor.width, recording.sensor.height)
    if size != (ring.width, ring.height):
        raise InputError(
            f"{options.scene}: the film is {ring.width} x {ring.height} pixels but the events of {options.events} "
            f"are {size[0]} x {size[1]}; make the film as large as the sensor region."
        )
    for name in ("contrast_threshold_on", "contrast_threshold_off"):
        threshold = np.asarray(getattr(recording.sensor, name))
        if threshold.min() < THRESHOLDS[0] or threshold.max() > THRESHOLDS[1]:
            raise InputError(
                f"{options.events}: {name} goes from {threshold.min():g} to {threshold.max():g}; "
                "write changes of natural log intensity, as 0.25."
            )
    unknown = int(np.max(recording.schedule.order))
    if unknown >= ring.leds.n_led:
        raise InputError(
            f"{options.events}: schedule/order lights LED {unknown}, but {options.scene} has only "
            f"{ring.leds.n_led} LEDs, numbered from 0; mend order or add the emitter."
        )
    if options.solver == "lm" and ring.leds.n_band > MAX_BANDS:
        raise InputError(
            f"{options.scene}: {ring.leds.n_band} bands are too many for the solver lm, which takes {MAX_BANDS}; "
            "use --solver adam."
        )


def object_mask(options, coverage: np.ndarray) -> np.ndarray:
    """Give the pixels to solve: those that the object covers and the user's mask holds."""
    mask = coverage >= 0.5
    if not mask.any():
        raise InputError(f"{options.scene}: the camera does not see the shape object; move one of them.")
    if options.mask:
        mask &= read_mask(options.mask, mask.shape)
        if not mask.any():
            raise InputError(f"{options.mask}: the mask has no pixel of the object; draw it over the object.")
    return mask
