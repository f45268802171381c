"""Rough matt surfaces against Mitsuba's, and their derivatives."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from evsdr.model.gloss import GlossyRing, RoughCoating
from evsdr.model.rough import RoughRing
from evsdr.solve.unknowns import to_normal
from tests.support.analytic import ring_directions
from tests.support.glossy import floats, unit_vectors
from tests.support.sphere import SPECTRUM, ring_light

ROUGHNESS = 0.8


@pytest.fixture(scope="module")
def slopes():
    normal = unit_vectors(np.random.default_rng(0), 200, 0.3)
    return -normal[:, :2] / normal[:, 2:]


def signals(slopes, model):
    """Signals (n_led, n), and their derivatives by p and q."""
    reflectance = floats(*(np.full(len(slopes), r) for r in SPECTRUM))
    rows = model(*floats(*slopes.T), reflectance, mi.Float(1e-4))
    dr.eval(rows)
    return [np.array(row) for row in rows[:3]]


def test_signals_are_those_of_mitsuba(slopes):
    material = {"type": "principled", "specular": 0.0, "roughness": ROUGHNESS}
    bsdf = mi.load_dict(material | {"base_color": {"type": "uniform", "value": 0.5}})
    normal, found = to_normal(slopes), signals(slopes, RoughRing(ring_light(), mi.Float(ROUGHNESS)))[0]
    for j in (0, 7, 16):
        point = dr.zeros(mi.SurfaceInteraction3f, len(slopes))
        frame = mi.Frame3f(mi.Vector3f(normal.T.astype(np.float32)))
        point.wi = frame.to_local(mi.Vector3f(0, 0, 1))
        light_j = frame.to_local(mi.Vector3f(ring_directions()[j].astype(np.float32)))
        value = bsdf.eval(mi.BSDFContext(), point, light_j)[0].numpy() * np.pi / 0.5
        lit = normal @ ring_directions()[j] > 0.02
        np.testing.assert_allclose(found[j][lit] / SPECTRUM[j % 8], value[lit], rtol=0.02)


@pytest.mark.parametrize("coated", [False, True])
def test_derivatives_are_differences(slopes, coated):
    model = RoughRing(ring_light(), mi.Float(ROUGHNESS))
    if coated:
        lobe = RoughCoating(mi.Float(0.3), mi.Float(0.5))
        model = GlossyRing(ring_light(), lobe, None, mi.Float(ROUGHNESS))
    _, *given = signals(slopes, model)
    clear = np.abs(np.einsum("nk,jk->jn", to_normal(slopes), ring_directions())) > 0.02
    for k in range(2):
        step = 2e-3 * np.eye(2)[k]
        difference = (signals(slopes + step, model)[0] - signals(slopes - step, model)[0]) / 4e-3
        np.testing.assert_allclose(given[k][clear], difference[clear], atol=3e-3 * np.abs(difference).max())
