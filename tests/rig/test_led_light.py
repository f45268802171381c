"""Light of LEDs."""

import numpy as np
import pytest

from evsdr.rig.led_light import led_spectrum, square_form_factor


@pytest.mark.parametrize(
    "peak, left, right", [(525, 14, 19), (405, 7, 8), (650, 0.5, 0.5), (360, 10, 10), (830, 8, 8)]
)
def test_a_spectrum_has_its_peak_widths_and_integral(peak, left, right):
    nm, density = led_spectrum(peak, left, right)
    assert np.trapezoid(density, nm) == pytest.approx(1)
    assert 360 <= nm[0] < nm[-1] <= 830.001
    fine = np.linspace(nm[0], nm[-1], 20_001)
    above = fine[np.interp(fine, nm, density) > density.max() / 2]
    step = nm[1] - nm[0]
    assert above[0] == pytest.approx(max(peak - left, 360), abs=step / 2)
    assert above[-1] == pytest.approx(min(peak + right, 830), abs=step / 2)


def test_form_factor_far_away_is_that_of_a_point():
    assert np.pi * square_form_factor(0.1, 10.0) == pytest.approx(0.1**2 / 10.0**2, rel=1e-3)
