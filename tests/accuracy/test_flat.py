"""A plane under far LEDs: all its pixels say the same, and what they share can pass for its tilt."""

import numpy as np
import pytest

import evsdr
from experiments.draws.__main__ import record
from experiments.draws.cases import Draw

SIZE = 20
GLOSSY = Draw(
    seed=39,
    shape="plane",
    material="gloss",
    leds="far",
    pixel="evk4",
    known=False,
    perspective=False,
    pauses=True,
    polar_deg=33.0,
    constant_light=0.128,
    slot_us=17_500.0,
    crossfade=1.0,
    rounds=5,
    on=0.225,
    off=0.219,
    event_noise=0.1,
    refractory_us=27.5,
    power=0.0,
    told_threshold=1.0,
    told_refractory=1.0,
)


@pytest.mark.filterwarnings("ignore::evsdr.InputWarning")
def test_gloss_that_led_powers_pass_for_is_named_and_paid_for():
    """Powers that a few percent are left of explain a lobe; normals are then seven degrees off, and were said to be known to two."""
    told, recording, truth = record(GLOSSY, SIZE)
    found = evsdr.fit(told, recording, mask=truth.mask)
    known = truth.mask & found.maps.mask
    error = evsdr.angular_error_deg(found.maps.normal, truth.normal)[known]
    assert np.mean(error <= 2 * found.maps.normal_sigma_deg[known]) > 0.97
    off = np.abs(found.maps.reflectance - truth.reflectance)[known]
    assert np.mean(off <= 3 * found.maps.reflectance_sigma[known]) > 0.97
    assert "gloss" in found.summary["verdict"] or error.mean() < 1
