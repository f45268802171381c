"""The parameters of an event pixel; `simulator` runs it."""

from dataclasses import dataclass, fields, replace

import numpy as np

from evsdr.errors import InputError

SMALLEST_THRESHOLD = 0.02  # fixed pattern and noise of the thresholds go no lower


@dataclass(frozen=True)
class EventPixel:
    """An event pixel; the defaults are an EVK4 (IMX636) at default biases.

    Attributes
    ----------
    contrast_threshold_on, contrast_threshold_off : float
        Change of natural log intensity that fires an event; 0.02 at least.
    spread_on, spread_off : float
        Standard deviation of the fixed, spatially white pattern added to each threshold.
    event_noise : float
        Relative standard deviation of the thresholds from one event to the next.
    refractory_us : float
        Time after an event until the reference is memorised anew [us].
    cutoff_hz : float
        Cutoff of the photoreceptor at I = 1 [Hz], proportional to I; 0 for none. The default lags by 53 us
        there and by 660 us at I = 0.08.
    photon_rate_per_us : float
        Photo-electrons at I = 1 [1/us]; 0 for no shot noise. The default makes noise of 0.01 behind the
        photoreceptor, 1/26 of the threshold: times jitter, and only the few pixels with the lowest thresholds
        fire in steady light.
    leak_hz : float
        ON events of a pixel at rest [Hz].
    hot_fraction, hot_hz : float
        Share of pixels that leak more, and how much [Hz].

    Raises
    ------
    InputError
        A value makes no sense.
    """

    contrast_threshold_on: float = 0.2525
    contrast_threshold_off: float = 0.3795
    spread_on: float = 0.049
    spread_off: float = 0.039
    event_noise: float = 0.02
    refractory_us: float = 52.0
    cutoff_hz: float = 3000.0
    photon_rate_per_us: float = 100.0
    leak_hz: float = 0.1
    hot_fraction: float = 1e-4
    hot_hz: float = 1000.0

    @classmethod
    def ideal(cls, threshold: float = 0.25, refractory_us: float = 52.0) -> "EventPixel":
        """Give a pixel without spread, noise, lag and leak."""
        return cls(threshold, threshold, event_noise=0.0, refractory_us=refractory_us).idealised()

    def idealised(self) -> "EventPixel":
        """Leave out spread, lag, shot noise, leak and hot pixels.

        Thresholds, event noise and refractory period stay.
        """
        return replace(
            self,
            spread_on=0.0,
            spread_off=0.0,
            cutoff_hz=0.0,
            photon_rate_per_us=0.0,
            leak_hz=0.0,
            hot_fraction=0.0,
            hot_hz=0.0,
        )

    def __post_init__(self):
        for field in fields(self):
            value = getattr(self, field.name)
            smallest = SMALLEST_THRESHOLD if field.name.startswith("contrast") else 0
            if not smallest <= value < np.inf:
                raise InputError(f"{field.name} is {value:g}; give a number of {smallest:g} or more.")
        if self.hot_fraction > 1:
            raise InputError(f"hot_fraction is {self.hot_fraction:g}; give a share of the pixels, 0 to 1.")
        if self.photon_rate_per_us > 0 and self.cutoff_hz == 0:
            raise InputError(
                "photon_rate_per_us makes noise without bounds when cutoff_hz is 0; "
                "set photon_rate_per_us to 0 too, or give a cutoff."
            )
