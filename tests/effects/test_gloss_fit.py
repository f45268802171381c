from dataclasses import replace
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from evsdr.effects import gloss_fit
from evsdr.effects.gloss_fit import Gloss, fit_gloss, gloss_evidence, near_half_vector
from evsdr.effects.materials import sort_materials
from evsdr.light.ground_truth import surface_maps
from evsdr.light.scene import load_scene
from evsdr.model.gloss import GlossyRing, RoughCoating
from evsdr.model.lambert import LambertianRing
from evsdr.solve.event_terms import normal_equations
from evsdr.solve.loss import derivative_table, residuals, scaled
from evsdr.solve.pair_data import thin
from evsdr.solve.unknowns import to_theta
from tests.support.glossy import KINDS, floats, mean_error, sphere
from tests.support.sphere import SPECTRUM, solve

SCENES = Path(__file__).resolve().parents[2] / "scenes"


@pytest.fixture(scope="module")
def coated():
    """A coated sphere and the matt fit of it."""
    problem, normal, reflectance, _ = sphere([KINDS[1]])
    return problem, normal, reflectance, solve(problem)


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
        given = table, pairs, light.constant_light, 8, 0.3, 3.0, False, True
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
            table, pairs, light.constant_light, 8, 0.1, 3.0, False, True
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


def test_no_pixel_that_fires_shows_no_gloss(coated, monkeypatch):
    problem, *_, matt = coated
    monkeypatch.setattr(gloss_fit, "_some", lambda *_: np.zeros(0, np.int64))
    assert not gloss_evidence(problem, matt.theta, matt.noise).is_worth_modelling()
    assert fit_gloss(problem, matt.theta, matt.noise).strength == 0


def test_slopes_within_a_pixel_are_no_gloss():
    """No matt model of one normal holds there, in any round; the widest lobe explains that better than gloss does."""
    problem, *_ = sphere(tilt=1.0)
    matt = solve(problem)
    assert gloss_evidence(problem, matt.theta, matt.noise).z < 0
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
    glossy = solve(problem, model=GlossyRing(problem.illumination, gloss.lobe(mi.Float)))
    before, after = (mean_error(s.theta, normal) for s in (matt, glossy))
    assert after < 0.5 * before
    assert evidence.error_deg == pytest.approx(before, rel=0.4)


def test_thresholds_told_wrong_are_found_with_the_lobe(coated):
    """A matt fit takes gloss for smaller thresholds, and with these the lobe comes out weaker."""
    problem, _, _, matt = coated
    wrong = scaled(problem.pairs, [dr.opaque(mi.Float, 0.8)] * 2)
    told_wrong = replace(problem, pairs=wrong)
    n, spread = len(matt.theta), (0.0, 0.0, 0.3, 0.3)
    theta = np.column_stack([matt.theta, np.zeros((n, 2), np.float32)])
    gloss = fit_gloss(told_wrong, theta, matt.noise, spread=spread, shifted=True)
    assert gloss.log_threshold == pytest.approx(-np.log(0.8), abs=0.03)
    assert gloss.strength[0] == pytest.approx(0.8, rel=0.1)
    assert fit_gloss(told_wrong, theta, matt.noise, spread=spread).strength[0] < 0.7


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


def test_gloss_lengthens_the_tails_of_residuals(coated):
    problem, _, _, matt = coated
    light = problem.illumination
    u = residuals(LambertianRing(light), problem.pairs, light.constant_light, matt.theta).numpy()
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


def test_a_coating_on_one_half_is_found_there():
    """Asked of all pixels together the coating would hardly gain."""
    matt = (RoughCoating, 0.2, 0.0)
    problem, _, reflectance, left = sphere([(RoughCoating, 0.2, 1.0), matt], other=SPECTRUM)
    found = solve(problem)
    assert gloss_evidence(problem, found.theta, found.noise).is_worth_modelling()
    gloss = fit_gloss(problem, found.theta, found.noise)
    assert gloss.shape[0] == pytest.approx(0.2, rel=0.1) and gloss.strength[1] == 0
    near = near_half_vector(problem.illumination, found.theta)
    right_half = gloss.label[near] == 0
    assert np.mean(right_half == ~left[near]) > 0.9


@pytest.mark.parametrize(("label", "commonest"), [([2, 2, 2, 0, 0, 1, 1], 0), ([2, 2, 2, 0, 0], 2)])
def test_other_pixels_get_the_commonest_lobe(label, commonest):
    """If most pixels have one: where nothing tells, some count as matt."""
    gloss = Gloss(RoughCoating, np.array([0.2, 0.3, 1.0]), np.array([1.0, 0.5, 0.0]), np.array(label))
    assert gloss.commonest(4).label.tolist() == [commonest] * 4
