"""The event pixel as an option of commands: what all of them know has the same short name everywhere."""

from dataclasses import dataclass
from typing import Annotated

import tyro

from evsdr.events.pixel import EventPixel


def _also(*names: str) -> object:
    return tyro.conf.arg(aliases=list(names))


@dataclass(frozen=True)
class Pixel(EventPixel):
    """An event pixel; the defaults are an EVK4 (IMX636) at default biases."""

    contrast_threshold_on: Annotated[float, _also("--threshold-on")] = EventPixel.contrast_threshold_on
    """Contrast threshold of ON events (natural log)."""
    contrast_threshold_off: Annotated[float, _also("--threshold-off")] = EventPixel.contrast_threshold_off
    """Contrast threshold of OFF events (natural log)."""
    spread_on: float = EventPixel.spread_on
    """Standard deviation of the ON thresholds over the pixels."""
    spread_off: float = EventPixel.spread_off
    """Standard deviation of the OFF thresholds over the pixels."""
    event_noise: Annotated[float, _also("--event-noise", "--noise")] = EventPixel.event_noise
    """Relative standard deviation of the thresholds from one event to the next."""
    refractory_us: Annotated[float, _also("--refractory-us")] = EventPixel.refractory_us
    """Refractory period [us]."""
    cutoff_hz: float = EventPixel.cutoff_hz
    """Cutoff of the photoreceptor at I = 1 [Hz], proportional to I; 0 for none. The default lags by 53 us there and by
    660 us at I = 0.08."""
    photon_rate_per_us: float = EventPixel.photon_rate_per_us
    """Photo-electrons at I = 1 [1/us]; 0 for no shot noise."""
    leak_hz: float = EventPixel.leak_hz
    """ON events of a pixel at rest [Hz]."""
    hot_fraction: float = EventPixel.hot_fraction
    """Share of pixels that leak more."""
    hot_hz: float = EventPixel.hot_hz
    """How much they leak [Hz]."""
