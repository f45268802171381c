"""The parameters of an event pixel: what makes no sense, and what is left of one without imperfections."""

from dataclasses import asdict, replace

import numpy as np
import pytest

from evsdr.errors import InputError
from evsdr.events.pixel import EventPixel

KEPT = ("contrast_threshold_on", "contrast_threshold_off", "event_noise", "refractory_us")


@pytest.mark.parametrize(
    "change, field",
    [
        ({"contrast_threshold_on": 0.01}, "contrast_threshold_on"),
        ({"contrast_threshold_off": np.nan}, "contrast_threshold_off"),
        ({"refractory_us": -1.0}, "refractory_us"),
        ({"cutoff_hz": np.inf}, "cutoff_hz"),
        ({"hot_fraction": 1.5}, "hot_fraction"),
        ({"cutoff_hz": 0.0}, "photon_rate_per_us"),
    ],
)
def test_parameters_that_make_no_sense(change, field):
    with pytest.raises(InputError, match=f"^{field}.*(give|set)"):
        EventPixel(**change)


def test_an_idealised_pixel_keeps_what_a_fit_models():
    pixel = EventPixel(0.3, 0.4, event_noise=0.1, refractory_us=20.0)
    for name, value in asdict(pixel.idealised()).items():
        assert value == (getattr(pixel, name) if name in KEPT else 0.0), name


def test_an_ideal_pixel_has_no_noise_either():
    assert EventPixel.ideal(0.3, 20.0) == replace(EventPixel(0.3, 0.3, 0, 0, 0, 20.0).idealised())
