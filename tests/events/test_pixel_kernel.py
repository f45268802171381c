"""Parts of the event pixel's loop; test_brute_force.py has all of it."""

import numpy as np
import pytest

from evsdr.events.pixel import SMALLEST_THRESHOLD
from evsdr.events.pixel_kernel import _draw_thresholds
from tests.support.streams import draws


def test_thresholds_in_force():
    """Each is spread about its own mean, and none is smaller than the smallest."""
    on, off = draws(_draw_thresholds, 20_000, 0.2, 0.4, 0.1).T
    assert (on.mean(), off.mean()) == pytest.approx((0.2, 0.4), rel=0.01)
    assert (on.std(), off.std()) == pytest.approx((0.02, 0.04), rel=0.03)
    assert abs(np.corrcoef(on, off)[0, 1]) < 0.03
    assert draws(_draw_thresholds, 500, 0.025, 0.4, 0.5).min() == SMALLEST_THRESHOLD
    np.testing.assert_array_equal(draws(_draw_thresholds, 3, 0.2, 0.4, 0.0), np.tile([0.2, 0.4], (3, 1)))
