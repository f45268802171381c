"""Metal against plain NumPy, its derivatives, and normals that it shows alike."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from evsdr.model.metal import MetalRing
from evsdr.solve.unknowns import to_normal
from tests.support.analytic import ring_directions
from tests.support.glossy import floats, metal_signals, unit_vectors
from tests.support.sphere import SPECTRUM, ring_light

ALPHA = 0.25


@pytest.fixture(scope="module")
def slopes():
    normal = unit_vectors(np.random.default_rng(0), 200, 0.5)
    return -normal[:, :2] / normal[:, 2:]


def signals(slopes, spectrum=SPECTRUM, softness=1e-4):
    """Signals (n_led, n), and their derivatives by p and q."""
    reflectance = floats(*(np.full(len(slopes), r) for r in spectrum))
    model = MetalRing(ring_light(), mi.Float(ALPHA))
    rows = model(*floats(*slopes.T), reflectance, mi.Float(softness))
    dr.eval(rows)
    return [np.array(row) for row in rows]


def test_signals_are_those_of_facets_that_are_mirrors(slopes):
    normal = to_normal(slopes)
    truth = metal_signals(ALPHA, np.broadcast_to(SPECTRUM, (len(normal), 8)), normal, ring_directions())
    np.testing.assert_allclose(signals(slopes)[0], truth, rtol=2e-3, atol=1e-5)


def test_derivatives_are_differences(slopes):
    _, *given = signals(slopes)
    for k in range(2):
        step = 2e-3 * np.eye(2)[k]
        difference = (signals(slopes + step)[0] - signals(slopes - step)[0]) / 4e-3
        clear = np.abs(np.einsum("nk,jk->jn", to_normal(slopes), ring_directions())) > 0.02
        np.testing.assert_allclose(given[k][clear], difference[clear], atol=3e-3 * np.abs(difference).max())


def test_where_normals_are_spread_metal_is_rougher(slopes):
    assert signals(slopes, softness=0.3)[0].max() < 0.6 * signals(slopes)[0].max()


def test_twins_look_alike():
    """Far from half vectors facets reflect with a power of the angle, which an inversion keeps but for a factor."""
    model = MetalRing(ring_light(), mi.Float(0.02))
    tilt = np.tan(np.radians([30.0, 35.0, 40.0]))
    theta = np.column_stack([tilt, np.zeros(3), np.tile(np.log(SPECTRUM), (3, 1))])
    twin = np.array(model.twin(floats(*theta.T))).T
    assert np.degrees(np.arctan(twin[:, 0])) == pytest.approx([16.8, 14.3, 12.4], abs=0.2)

    def seen(theta):
        p, q, *rho = floats(*theta.T)
        signal = model(p, q, [dr.exp(r) for r in rho], mi.Float(1e-4))[0]
        dr.eval(signal)
        return np.array(signal)

    ratio = seen(twin) / seen(theta)
    assert np.ptp(np.log(ratio), axis=0).max() < 0.5 < np.ptp(np.log(seen(theta)), axis=0).min()
