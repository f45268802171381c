"""What may be but is not modelled is paid for in sigma, of known pixels only."""

import numpy as np

from evsdr.effects.effect import Decision
from evsdr.effects.gloss import Unseen
from evsdr.effects.payment import paid
from evsdr.records import Maps


def test_whoever_owes_pays():
    normal, known = np.tile(np.float32([0, 0, 1]), (2, 3, 1)), np.arange(6).reshape(2, 3) > 1
    bands = np.full((2, 3, 4), np.float32(0.3))
    maps = Maps(normal, bands, known, np.ones((2, 3), np.float32), 0.1 * bands, np.arange(4.0), known)
    owes = Decision("gloss", False, "why", answer=Unseen(3.0, np.full(maps.reflectance.shape[-1], 0.1)))
    told = {"a": Decision("a", True, "why", answer=object()), "gloss": owes, "b": Decision("b", False, "why")}
    found = paid(maps, told)
    np.testing.assert_allclose(
        found.normal_sigma_deg[known], np.hypot(maps.normal_sigma_deg[known], 3), rtol=1e-6
    )
    expected = np.minimum(np.hypot(maps.reflectance_sigma, 0.1 * maps.reflectance), 1)
    np.testing.assert_allclose(found.reflectance_sigma, expected, rtol=1e-6)
    np.testing.assert_array_equal(found.normal_sigma_deg[~known], maps.normal_sigma_deg[~known])
    assert paid(maps, {}) is maps
