"""What may be but is not modelled is paid for in sigma, of known pixels only."""

import numpy as np

from evsdr.effects.effect import Decision
from evsdr.effects.gloss import Unseen
from evsdr.effects.payment import paid, wider
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


def test_a_reflectance_is_off_by_1_at_most_or_by_itself():
    """As many as events tell hardly anything of lie far above 1."""
    normal, known = np.tile(np.float32([0, 0, 1]), (1, 2, 1)), np.ones((1, 2), bool)
    bands = np.float32([[[0.3], [3.0]]])
    maps = Maps(normal, bands, known, np.ones((1, 2), np.float32), 0.1 * bands, np.ones(1), known)
    assert wider(maps, 0.0, 20.0).reflectance_sigma.ravel().tolist() == [1.0, 3.0]
