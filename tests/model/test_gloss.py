"""Lobes against plain NumPy, Mitsuba and finite differences."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from evsdr.model.gloss import BlinnPhong, GlossyRing, RoughCoating
from evsdr.model.illumination import Illumination
from tests.support.analytic import lambert_signals, ring_directions
from tests.support.glossy import KINDS, floats, lobe_signals, unit_vectors, vectors
from tests.support.sphere import SPECTRUM


@pytest.mark.parametrize(
    "plugin",
    [dict(type="roughdielectric", distribution="ggx", alpha=0.16), dict(type="principled", roughness=0.4)],
)
def test_the_coating_is_mitsubas(plugin, rng):
    """The reflection of `roughdielectric` and of `principled` with a black base, both of index 1.5."""
    if plugin["type"] == "principled":
        plugin |= dict(specular=0.5, base_color=dict(type="uniform", value=0.0))
    else:
        plugin |= dict(int_ior=1.5, ext_ior=1.0)
    light, view = (vectors(unit_vectors(rng, 500)) for _ in range(2))
    si = dr.zeros(mi.SurfaceInteraction3f, 500)
    si.n, si.sh_frame = mi.Vector3f(0, 0, 1), mi.Frame3f(mi.Vector3f(0, 0, 1))
    si.wi, si.wavelengths = view, mi.Spectrum(500.0)
    expected = dr.pi * mi.load_dict(plugin).eval(mi.BSDFContext(), si, light)[0]
    value, _ = RoughCoating(mi.Float(0.16), mi.Float(1.0))(mi.Vector3f(0, 0, 1), light, view)
    assert np.ptp(expected.numpy()) > 1
    np.testing.assert_allclose(value.numpy(), expected.numpy(), rtol=2e-4, atol=1e-6)


@pytest.mark.parametrize("kind, shape, strength", [*KINDS, (BlinnPhong, 1.5, 0.3)])
def test_signals_are_those_of_plain_numpy(kind, shape, strength, rng):
    """Lambertian part and lobe, LEDs behind the horizon included."""
    normal, direction = unit_vectors(rng, 300, 0.05), ring_directions()
    light = Illumination(
        [mi.Vector3f(*d) for d in direction.tolist()], [mi.Float(2.0)] * 24, [j % 8 for j in range(24)], None
    )
    model = GlossyRing(light, kind(mi.Float(shape), mi.Float(strength)))
    p, q = floats(*(-normal[:, :2] / normal[:, 2:]).T)
    signal, _, _, diffuse = model(p, q, floats(*np.tile(SPECTRUM[:, None], 300)), mi.Float(1e-6))
    matt = 2 * lambert_signals(normal, np.tile(SPECTRUM, (300, 1)), direction)
    glossy = 2 * lobe_signals(kind, shape, strength, normal, direction)
    np.testing.assert_allclose([d.numpy() for d in diffuse], matt, atol=1e-5)
    np.testing.assert_allclose([s.numpy() for s in signal], matt + glossy, atol=1e-5)


@pytest.mark.parametrize("kind, shape, strength", KINDS)
def test_each_pixel_is_seen_from_its_own_side(kind, shape, strength, rng):
    """What the lobe adds depends on angles alone: normals, LED and camera may turn together."""
    normal, view = unit_vectors(rng, 100, 0.5), unit_vectors(rng, 100, 1.0)
    light = Illumination([vectors(unit_vectors(rng, 1, 1.0))], [mi.Float(2.0)], [0], None)
    lobe = kind(mi.Float(shape), mi.Float(strength))
    p, q = floats(*(-normal[:, :2] / normal[:, 2:]).T)
    signal, _, _, diffuse = GlossyRing(light, lobe, vectors(view))(p, q, [mi.Float(0.5)], mi.Float(1e-6))
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turned = (vectors(v @ turn.T) for v in (normal, np.array(light.direction[0]).T, view))
    expected = 2 * lobe(*turned)[0].numpy()
    np.testing.assert_allclose(signal[0].numpy() - diffuse[0].numpy(), expected, rtol=1e-3, atol=1e-5)
    assert np.ptp(expected) > 0.1


@pytest.mark.parametrize("kind, shape, strength", KINDS)
def test_derivatives_are_finite_differences(kind, shape, strength, rng):
    """Near LEDs and a camera direction per pixel, too; where LED and camera are above the horizon."""
    normal, view = unit_vectors(rng, 400, 0.4), unit_vectors(rng, 400, 1.0)
    direction = np.array([unit_vectors(rng, 400, 0.3) for _ in range(3)])
    clear = (np.sum(normal * direction, axis=-1) > 0.1) & (np.sum(normal * view, axis=-1) > 0.1)
    light = Illumination([vectors(d) for d in direction], [mi.Float(1.5)] * 3, [0, 1, 0], None)
    model = GlossyRing(light, kind(mi.Float(shape), mi.Float(strength)), vectors(view))
    slopes = -normal[:, :2] / normal[:, 2:]
    log_reflectance = np.log(np.tile([0.3, 0.6], (400, 1)))

    def evaluate(shift):
        theta = np.concatenate([slopes, log_reflectance], axis=1) + shift
        p, q, *rho = floats(*theta.T)
        rows = model(p, q, [dr.exp(r) for r in rho], mi.Float(0.2))
        return [np.array([v.numpy() for v in row], float) for row in rows]

    _, by_p, by_q, diffuse = evaluate(np.zeros(4))
    band = np.array([0, 1, 0])[:, None]
    step = 2e-3
    analytic = [by_p, by_q, *(np.where(band == b, diffuse, 0) for b in range(2))]
    for direction, derivative in zip(np.eye(4), analytic):
        difference = (evaluate(step * direction)[0] - evaluate(-step * direction)[0]) / (2 * step)
        tolerance = 2e-3 * np.abs(derivative).max() + 1e-4
        np.testing.assert_allclose(derivative[clear], difference[clear], atol=tolerance)
