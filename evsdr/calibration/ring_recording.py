"""A recording and the scene under whose ring it was made: what calibrations of LEDs share."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from evsdr.calibration.equations import Estimate
from evsdr.calibration.watched import Watched
from evsdr.errors import InputError, InputWarning
from evsdr.files.events_h5 import read_recording
from evsdr.light.checks import check_film, check_object
from evsdr.records import Recording
from evsdr.solve.noise import MISFIT


def read_ring_events(path: Path, ring) -> Recording:
    """Read a recording and check that it belongs to the scene."""
    recording = read_recording(path)
    check_film(ring, recording)
    trim, order = trim_of(recording, ring.leds.n_led), recording.schedule.order
    lit = {led for led in order[order >= 0].tolist() if led < len(trim) and trim[led] > 0}
    if lit != set(range(ring.leds.n_led)):
        raise InputError(
            f"{path}: schedule/order lights {len(lit)} LEDs but {ring.path} has {ring.leds.n_led}; light each "
            "of them."
        )
    return recording


def trim_of(recording: Recording, n_led: int) -> np.ndarray:
    """Give the brightness of each LED (n_led,), relative to what its calibration is for."""
    trim = recording.schedule.trim
    return np.ones(n_led) if trim is None else np.asarray(trim, float)[:n_led]


def count_events(recording: Recording) -> np.ndarray:
    """Count the events of each pixel (H, W)."""
    height, width = recording.sensor.height, recording.sensor.width
    where = recording.events.y.astype(np.int64) * width + recording.events.x
    return np.bincount(where, minlength=height * width).reshape(height, width)


@dataclass(frozen=True)
class NominalLight:
    """The light of a ring as its scene file states it.

    Attributes
    ----------
    direction : (n_led, n, 3) float
        Unit vectors to the LEDs, camera frame; n is 1 for far LEDs, else the number of pixels that see the object.
    gain : (n_led, n) float
        Fall-off.
    mask : (height, width) bool
        Pixels that see the object.
    """

    direction: np.ndarray
    gain: np.ndarray
    mask: np.ndarray

    @property
    def near(self) -> bool:
        """Whether LEDs look different from each pixel."""
        return self.direction.shape[1] > 1

    @property
    def mean_direction(self) -> np.ndarray:
        """Mean unit vector (n_led, 3) to each LED."""
        mean = self.direction.mean(axis=1)
        return mean / np.linalg.norm(mean, axis=1, keepdims=True)


def nominal_light(ring) -> NominalLight:
    """Trace the light of a scene's ring on its object."""
    from evsdr.light.tracing import trace_illumination

    light, coverage = trace_illumination(ring, 1, False)
    mask = coverage >= 0.5
    check_object(ring, mask)

    def pick(value) -> np.ndarray:
        array = np.asarray(value, float).reshape(-1, np.asarray(value).shape[-1])
        return array if array.shape[1] == 1 else array[:, mask.ravel()]

    direction = [pick(d).T for d in light.direction]
    gain = [pick(e)[0] / power for e, power in zip(light.irradiance, ring.leds.power)]
    n = max(len(d) for d in direction)
    direction = np.stack([np.broadcast_to(d, (n, 3)) for d in direction])
    return NominalLight(direction, np.stack([np.broadcast_to(g, (n,)) for g in gain]), mask)


def fit_result(solution: Estimate, parts: Sequence[Watched]) -> dict:
    """Give what calibration.json holds of a fit, and warn of what speaks against it."""
    if solution.noise > MISFIT:
        warnings.warn(
            InputWarning(
                f"the events scatter by {solution.noise:.0%} of a threshold around the model; check order, slot_us, "
                "triggers, thresholds, and what the camera saw."
            )
        )
    if not solution.converged:
        warnings.warn(InputWarning("the estimate has not settled; its sigma is too small."))
    return {
        "pixels": sum(len(part.number) for part in parts),
        "pairs": len(solution.residual),
        "relative_threshold_noise": solution.noise,
        "settled": solution.converged,
        "photoreceptor_lag_ms_at_constant_light": _entry(solution, "tau", 1e-3),
        "photoreceptor_noise": _entry(solution, "noise"),
        "photoreceptor_dark_current_over_constant_light": _entry(solution, "dark"),
        "shift_us": _entry(solution, "shift"),
        "refractory_us": _entry(solution, "refractory", told=parts[0].refractory_us),
        "leak_per_s": _entry(solution, "leak", 1e6),
        "log_threshold_over_told": {name: _entry(solution, name) for name in ("on", "off")},
    }


def _entry(solution: Estimate, name: str, unit: float = 1.0, told: float = 0.0) -> dict:
    return {"value": told + unit * solution.sensor[name], "sigma": unit * solution.sensor_sigma[name]}
