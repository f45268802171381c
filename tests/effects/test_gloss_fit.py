from dataclasses import replace
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from evsdr.commands.simulate import Options
from evsdr.effects.gloss_fit import fit_gloss, gloss_evidence, sort_materials
from evsdr.events.pairs import pair_events
from evsdr.events.pixel import EventPixel
from evsdr.events.record import record
from evsdr.light.ground_truth import surface_maps
from evsdr.light.scene import load_scene
from evsdr.metrics import angular_error_deg
from evsdr.model.gloss import BlinnPhong, GlossyRing, RoughCoating
from evsdr.model.illumination import Illumination
from evsdr.model.lambert import LambertianRing
from evsdr.solve import levenberg
from evsdr.solve.loss import derivative_table, normal_equations, pair_residuals
from evsdr.solve.pair_data import thin
from evsdr.solve.problem import make_problem
from evsdr.solve.published import gate_weights, pair_weights
from evsdr.solve.unknowns import to_theta
from tests.support.analytic import lambert_signals, ring_directions, sphere_normals

C_W = 0.05
SPECTRUM = np.array([0.1, 0.25, 0.3, 0.4, 0.5, 0.6, 0.7, 0.6])
OTHER = SPECTRUM[::-1]
KINDS = [(BlinnPhong, 20.0, 0.3), (RoughCoating, 0.2, 0.8)]
SCENES = Path(__file__).resolve().parents[2] / "scenes"


def floats(*values):
    return [mi.Float(np.atleast_1d(v).astype(np.float32)) for v in values]


def vectors(array):
    return mi.Vector3f(np.ascontiguousarray(np.atleast_2d(array).T, np.float32))


def unit_vectors(rng, n, least_z=0.1):
    v = rng.normal(size=(n, 3))
    v[:, 2] = np.abs(v[:, 2]) + least_z
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def lobe_signals(kind, shape, strength, normal, direction):
    """The signals of a lobe (n_led, ...) in plain NumPy, seen along z."""
    half = direction + [0, 0, 1]
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    nh, nl = (np.einsum("...k,jk->j...", normal, d) for d in (half, direction))
    if kind is BlinnPhong:
        return np.where(nl > 0, strength * np.maximum(nh, 0) ** shape, 0)

    def tan2(cosine):
        return 1 / np.clip(cosine, 1e-6, 1) ** 2 - 1

    c = half[:, 2].reshape(-1, *[1] * (normal.ndim - 1))
    inside = np.sqrt(1 - (1 - c**2) / 1.5**2)
    fresnel = 0.5 * (
        ((c - 1.5 * inside) / (c + 1.5 * inside)) ** 2 + ((1.5 * c - inside) / (1.5 * c + inside)) ** 2
    )
    nh = np.clip(nh, 0.01, 1)
    facets = 1 / (np.pi * shape**2 * nh**4 * (1 + tan2(nh) / shape**2) ** 2)
    shadow = [2 / (1 + np.sqrt(1 + shape**2 * tan2(x))) for x in (nl, normal[..., 2])]
    value = np.pi * strength * fresnel * facets * shadow[0] * shadow[1] / (4 * normal[..., 2].clip(1e-6))
    return np.where(nl > 0, value, 0)


def sphere(lobes=(), size=40, event_noise=0.1, seed=0):
    """A recorded sphere, the solver's view of it, and its truth: normals, reflectances, left half.

    `lobes` are (kind, shape, strength), one for all or one for each half.
    """
    normal, mask = sphere_normals(size)
    left = np.broadcast_to(np.arange(size) < size // 2, (size, size))
    reflectance = np.where(left[..., None] & (len(lobes) > 1), OTHER, SPECTRUM)
    direction = ring_directions()
    signal = lambert_signals(normal, reflectance, direction)
    for i, lobe in enumerate(lobes):
        where = left == (i == 1) if len(lobes) > 1 else True
        signal = signal + where * lobe_signals(*lobe, normal, direction)
    pixel = EventPixel(0.2, 0.2, event_noise=event_noise)
    options = Options(out=Path(), ideal=True, slot_us=10_000.0, pixel=pixel, seed=seed)
    recording = record(np.where(mask, signal, 0), C_W, options)
    light = Illumination(
        [mi.Vector3f(*d) for d in direction.tolist()],
        [mi.Float(1.0)] * 24,
        [j % 8 for j in range(24)],
        mi.Float(C_W),
    )
    problem = make_problem(recording, pair_events(recording, mask), light, mask)
    return problem, normal[mask], reflectance[mask], left[mask]


def solve(problem, model=None):
    n = problem.n_pixel
    start = to_theta(np.tile([0.0, 0.0, 1.0], (n, 1)), np.full((n, 8), 0.25), mi.Float)
    light = problem.illumination
    model = model or LambertianRing(light)
    effort = levenberg.Effort(priors=None)
    return levenberg.solve(model, problem.pairs, light.constant_light, start, problem.grid, effort)


def mean_error(theta, normal):
    return angular_error_deg(np.column_stack([-theta[:, :2], np.ones(len(theta))]), normal).mean()


@pytest.fixture(scope="module")
def coated():
    """A coated sphere and the matt fit of it."""
    problem, normal, reflectance, _ = sphere([KINDS[1]])
    return problem, normal, reflectance, solve(problem)


# ---------------------------------------------------------------------- lobes and model


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


@pytest.mark.parametrize("kind, shape, strength", KINDS)
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


# ---------------------------------------------------------------------- in the normal equations


def test_normal_equations_know_what_scales_with_reflectance(coated):
    """Cost and gradient agree by finite differences, for slopes and for log reflectances."""
    problem, normal, reflectance, _ = coated
    pairs = thin(problem.pairs, 40)
    n, light = problem.n_pixel, problem.illumination
    model = GlossyRing(light, RoughCoating(mi.Float(0.3), mi.Float(1.5)))
    theta = np.array([t.numpy() for t in to_theta(normal, 0.8 * reflectance, mi.Float)], float)

    def evaluate(theta):
        p, q, *rho = floats(*theta)
        signal, by_p, by_q, diffuse = model(p, q, [dr.exp(r) for r in rho], mi.Float(0.01))
        table = derivative_table(signal, by_p, by_q, light.band, n, diffuse)
        given = table, pairs, light.constant_light, dr.opaque(mi.UInt32, n), 8, 0.3, 3.0, False, 0.9
        cost, gradient, _ = normal_equations(*given)
        return cost.numpy().astype(float), np.array([g.numpy() for g in gradient])

    _, gradient = evaluate(theta)
    inner = normal[:, 2] > 0.6
    for i in range(10):
        shift = np.zeros((10, 1))
        shift[i] = 5e-3
        difference = (evaluate(theta + shift)[0] - evaluate(theta - shift)[0]) / 1e-2
        off = np.abs(gradient[i] - difference)[inner]
        assert np.median(off) < 0.01 * np.abs(gradient[i][inner]).mean() + 0.01


def test_weights_count(coated):
    """A pair of weight 2 counts twice, one of weight 0 not at all."""
    problem, normal, reflectance, _ = coated
    n, light = problem.n_pixel, problem.illumination
    p, q, *rho = to_theta(normal, reflectance, mi.Float)
    signals = LambertianRing(light)(p, q, [dr.exp(r) for r in rho], mi.Float(0.01))
    table = derivative_table(*signals, light.band, n)

    def terms(weight):
        pairs = problem.pairs if weight is None else replace(problem.pairs, weight=weight)
        cost, gradient, matrix = normal_equations(
            table, pairs, light.constant_light, dr.opaque(mi.UInt32, n), 8, 0.1, 3.0, False, 0.9
        )
        return np.array([v.numpy() for v in (cost, *gradient, *matrix)])

    n_pair = dr.width(problem.pairs.phases) // 2
    once, twice, none = (terms(w) for w in (None, dr.full(mi.Float, 2, n_pair), dr.zeros(mi.Float, n_pair)))
    np.testing.assert_allclose(twice, 2 * once, rtol=1e-5)
    assert not none.any()


# ---------------------------------------------------------------------- finding gloss


def test_a_matt_sphere_shows_no_gloss():
    problem, *_ = sphere()
    matt = solve(problem)
    evidence = gloss_evidence(problem, matt.theta, matt.noise)
    assert not evidence.is_worth_modelling()
    assert abs(evidence.z) < 4 and evidence.error_deg < 0.05
    assert fit_gloss(problem, matt.theta, matt.noise).strength == 0


@pytest.mark.parametrize("kind, shape, strength", [KINDS[0]])
def test_blinn_phong_is_found(kind, shape, strength):
    problem, *_ = sphere([(kind, shape, strength)])
    matt = solve(problem)
    gloss = fit_gloss(problem, matt.theta, matt.noise, kind)
    assert gloss.shape[0] == pytest.approx(shape, rel=0.1)
    assert gloss.strength[0] == pytest.approx(strength, rel=0.1)


def test_the_coating_is_found_and_mends_the_maps(coated):
    problem, normal, _, matt = coated
    evidence = gloss_evidence(problem, matt.theta, matt.noise)
    gloss = fit_gloss(problem, matt.theta, matt.noise)
    assert evidence.is_worth_modelling()
    assert gloss.shape[0] == pytest.approx(0.2, rel=0.05)
    assert gloss.strength[0] == pytest.approx(0.8, rel=0.08)
    glossy = solve(problem, GlossyRing(problem.illumination, gloss.lobe(mi.Float)))
    before, after = (mean_error(s.theta, normal) for s in (matt, glossy))
    assert after < 0.5 * before
    assert evidence.error_deg == pytest.approx(before, rel=0.4)


def test_materials_have_their_own_lobes():
    """A broad strong lobe on one half, a narrow weak one on the other."""
    problem, normal, reflectance, left = sphere([(RoughCoating, 0.35, 1.5), (RoughCoating, 0.12, 0.5)])
    theta = np.array([t.numpy() for t in to_theta(normal, reflectance, mi.Float)]).T
    label = sort_materials(reflectance)
    assert label.max() == 1 and np.ptp(label[left]) == np.ptp(label[~left]) == 0
    gloss = fit_gloss(problem, theta, 0.1, RoughCoating, label)
    right_half, left_half = label[~left][0], label[left][0]
    assert gloss.shape[[right_half, left_half]] == pytest.approx([0.35, 0.12], rel=0.1)
    assert gloss.strength[[right_half, left_half]] == pytest.approx([1.5, 0.5], rel=0.15)


def test_materials_are_as_many_as_spectra(rng):
    spectra = rng.uniform(0.1, 0.8, (4, 8))
    for n in (1, 2, 3, 4):
        kind = rng.choice(n, 2000, p=np.arange(n, 0, -1) / sum(range(n + 1)))  # of different sizes
        noisy = spectra[kind] * rng.uniform(0.3, 1, (2000, 1)) * np.exp(0.03 * rng.normal(size=(2000, 8)))
        label = sort_materials(noisy)
        assert label.max() + 1 == n
        assert all(np.ptp(label[kind == k]) == 0 for k in range(n))


# ---------------------------------------------------------------------- without a lobe


def test_the_gate_closes_on_the_half_vector(coated):
    problem, normal, _, _ = coated
    light = problem.illumination
    weights = gate_weights(light, vectors(normal), floor=0.2)
    half = ring_directions() + [0, 0, 1]
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    angle = np.degrees(np.arccos(np.clip(half @ normal.T, -1, 1)))
    values = np.array([w.numpy() for w in weights])
    assert values.min() == pytest.approx(0.2, abs=0.02)
    np.testing.assert_allclose(values[angle > 40], 1, atol=1e-3)
    np.testing.assert_allclose(values, 1 - 0.8 * np.exp(-((angle / 11.88) ** 2)), atol=2e-3)
    pair = pair_weights(problem.pairs, weights).numpy()
    assert len(pair) == dr.width(problem.pairs.phases) // 2
    assert 0.02 < pair.min() < 0.3 and 0.99 < pair.max() <= 1


def test_gloss_lengthens_the_tails_of_residuals(coated):
    problem, _, _, matt = coated
    light = problem.illumination
    given = problem.pairs, light.constant_light, matt.theta
    u = pair_residuals(LambertianRing(light), *given)
    assert 1.4826 * np.median(np.abs(u)) == pytest.approx(matt.noise, rel=0.1)


def test_the_glossy_scenes_truth_is_its_base():
    """Truth is the reflectance under the coating, which `principled` lets pass whole."""
    ring = load_scene(SCENES / "glossy_sphere.xml", {"size": "8"})
    maps = surface_maps(ring, 1)
    inner = maps.reflectance[maps.mask]
    assert np.ptp(inner, axis=0).max() < 1e-5
    wavelength = maps.band_wavelength_nm
    expected = np.interp(wavelength, [360, 450, 520, 580, 650, 830], [0.10, 0.15, 0.30, 0.45, 0.55, 0.60])
    np.testing.assert_allclose(inner[0], expected, atol=0.02)
