"""The search for one number that makes events agree."""

import numpy as np
import pytest

from evsdr.solve.trial import search_scalar

CANDIDATES = (0.0, 10.0, 20.0, 40.0, 80.0)


@pytest.mark.parametrize("true", [0.0, 17.0, 33.0, 80.0])
def test_a_parabola_is_found_with_its_width(true):
    found = search_scalar(lambda x: 0.5 * ((np.asarray(x) - true) / 3.0) ** 2, CANDIDATES)
    assert found.value == pytest.approx(true, abs=1e-6) and found.sigma == pytest.approx(3.0)
    best = min(CANDIDATES, key=lambda c: abs(c - true))
    assert found.gain == pytest.approx((true**2 - (best - true) ** 2) / 18)


def test_narrower_parabolas_come_nearer():
    """The vertex of a wide one is off where costs are lopsided."""

    def costs(x):
        away = np.asarray(x) - 22
        return (away / 3) ** 2 + 2e-3 * away**3

    once, thrice = (search_scalar(costs, CANDIDATES, n).value for n in (1, 3))
    assert abs(thrice - 22) < 0.1 < 0.5 < abs(once - 22)


def test_without_a_bottom_the_coarse_ones_have_to_do():
    def costs(x):
        x = np.asarray(x)
        return np.where(np.isin(x, CANDIDATES), (x - 20) ** 2, -((x - 20) ** 2))

    found = search_scalar(costs, CANDIDATES)
    assert found.value == pytest.approx(20) and found.sigma == pytest.approx(0.5**0.5)


def test_one_candidate_is_what_is_found():
    found = search_scalar(lambda x: np.ones(len(x)), (5.0,))
    assert (found.value, found.gain) == (5.0, 0.0)
