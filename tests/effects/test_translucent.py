"""Translucent spheres look flatter, and their reflectance says so."""

from types import SimpleNamespace

import numpy as np
import pytest

from evsdr.effects.effect import Decision
from evsdr.effects.payment import paid
from evsdr.effects.translucent import (
    NAME,
    RIM_DEG,
    Translucency,
    Translucent,
    flattening,
    outline_tilt,
    outline_wrap,
    ring_axis,
)
from evsdr.effects.world import Terms
from evsdr.metrics import angular_error_deg
from evsdr.records import Maps
from tests.support.analytic import ring_directions, sphere_normals
from tests.support.glossy import vectors
from tests.support.sphere import SPECTRUM, ring_light

AXIS, COSINE = np.array([0.0, 0.0, 1.0]), np.sqrt(0.5)


def fit_of(wrap, seed=0):
    """The maps that a matt fit finds of a sphere of one material, with some noise, and the true normals."""
    normal, mask = sphere_normals(40)
    lifted = normal + wrap / COSINE * AXIS
    size = np.linalg.norm(lifted, axis=-1, keepdims=True)
    noise = np.random.default_rng(seed).normal(0, 0.01, (40, 40, 8))
    reflectance = np.where(mask[..., None], SPECTRUM * size / (1 + wrap) * np.exp(noise), 0)
    sigma = np.full((40, 40), 0.2, np.float32)
    values = lifted / size, reflectance, mask, sigma, 0.01 * reflectance, np.arange(8.0), mask
    return Maps(*(np.float32(v) if v.dtype == float else v for v in values)), normal


def test_a_fit_of_it_explains_the_same_light():
    maps, normal = fit_of(0.5)
    cosine, real = (np.einsum("ijk,lk->ijl", n, ring_directions()) for n in (maps.normal, normal))
    light = np.maximum(real + 0.5, 0) / 1.5
    size = np.linalg.norm(normal + 0.5 / COSINE * AXIS, axis=-1, keepdims=True)
    np.testing.assert_allclose(np.maximum(cosine, 0) * size / 1.5, light, atol=1e-5)


@pytest.mark.parametrize("wrap", [0.3, 0.6])
def test_its_wrap_is_found_and_its_normals(wrap):
    maps, normal = fit_of(wrap)
    found, gain, _ = flattening(maps, AXIS, COSINE)
    assert found == pytest.approx(wrap, abs=0.05) and gain > 10
    real, factor = Translucent(wrap, AXIS, COSINE).real(maps.normal.astype(float))
    assert angular_error_deg(real, normal)[maps.mask].max() < 0.1
    np.testing.assert_allclose((factor[..., None] * maps.reflectance)[maps.mask].mean(0), SPECTRUM, rtol=0.01)


def test_what_is_matt_or_textured_is_none():
    maps, _ = fit_of(0.0)
    assert flattening(maps, AXIS, COSINE)[0] < 0.1
    maps, _ = fit_of(0.5)
    maps.reflectance[:, ::2] *= 2
    assert flattening(maps, AXIS, COSINE) == (0.0, 0.0, 0.0)
    maps.mask[:] = False
    assert flattening(maps, AXIS, COSINE) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(("wrap", "texture", "named"), [(0.5, 0.1, True), (0.3, 0.2, False)])
def test_it_is_named_where_enough_of_the_scatter_goes_with_it(wrap, texture, named):
    maps, _ = fit_of(wrap)
    maps.reflectance[:] *= np.exp(np.random.default_rng(1).normal(0, texture, (40, 40, 1)))
    found, gain, _ = flattening(maps, AXIS, COSINE)
    assert found > 0.25 and gain > 1.2
    fitted = SimpleNamespace(maps=maps, problem=SimpleNamespace(illumination=ring_light()))
    assert bool(Translucency().decide("auto", world_of(), fitted).doubt) == named


@pytest.mark.parametrize(("whole", "named"), [(True, True), (False, False)])
def test_less_is_needed_where_an_outline_looks_outward_and_not_steep(whole, named):
    maps, _ = fit_of(0.3)
    maps.reflectance[:] *= np.exp(np.random.default_rng(1).normal(0, 0.15, (40, 40, 1)))
    fitted = SimpleNamespace(maps=maps, problem=SimpleNamespace(illumination=ring_light()))
    world = world_of(mask=maps.mask if whole else np.ones_like(maps.mask))
    doubt = Translucency().decide("auto", world, fitted).doubt
    assert bool(doubt) == named
    assert not doubt or "the outline looks no steeper than 58 degrees" in doubt


def test_how_steep_an_outline_looks():
    """Asked of those of its pixels that look outward, and of none where most look elsewhere, or few are seen."""
    matt, _ = fit_of(0.0)
    wrapped, _ = fit_of(0.5)
    assert outline_tilt(matt, matt.mask, AXIS) > 75
    edge = np.degrees(np.arctan(COSINE / 0.5))
    assert edge - 8 < outline_tilt(wrapped, wrapped.mask, AXIS) < edge
    assert outline_tilt(matt, np.ones_like(matt.mask), AXIS) is None
    matt.normal[..., :2] *= -1
    assert outline_tilt(matt, matt.mask, AXIS) is None


def test_an_outline_tells_the_wrap_too():
    """The way there and back; and it is paid for where reflectances, noisy as they are, tell less."""
    rim = np.array([np.sin(np.radians(RIM_DEG)), 0, np.cos(np.radians(RIM_DEG))]) + 0.4 / COSINE * AXIS
    assert outline_wrap(np.degrees(np.arctan2(rim[0], rim[2])), COSINE) == pytest.approx(0.4)
    maps, _ = fit_of(0.5)
    maps.reflectance[:] *= Translucent(0.5, AXIS, COSINE).real(maps.normal)[1][..., None] ** 0.5
    assert 0.2 < flattening(maps, AXIS, COSINE)[0] < 0.35
    fitted = SimpleNamespace(maps=maps, problem=SimpleNamespace(illumination=ring_light()))
    decision = Translucency().decide("auto", world_of(mask=maps.mask), fitted)
    tilt = outline_tilt(maps, maps.mask, AXIS)
    assert decision.found["wrap"] == pytest.approx(outline_wrap(tilt, COSINE), abs=1e-3)


def test_what_looks_steeper_than_it_could_is_none():
    """A third of the pixels as steep as no translucent surface looks, their reflectance too low by error."""
    maps, _ = fit_of(0.0)
    steep = maps.normal[..., 2] < 0.6
    assert 0.2 < np.mean(steep[maps.mask]) < 0.5
    maps.reflectance[:] *= (0.6 + 0.4 * maps.normal[..., 2])[..., None]
    wrap, *_ = flattening(maps, AXIS, COSINE)
    assert wrap < 0.2


def test_pixels_that_are_unsure_are_not_asked():
    maps, _ = fit_of(0.5)
    x, y = np.indices(maps.mask.shape)
    sure = (x + y) % 5 < 3
    maps.normal_sigma_deg[~sure] = 5.0
    before = flattening(maps, AXIS, COSINE)
    maps.reflectance[~sure] = 0.5
    assert flattening(maps, AXIS, COSINE) == before and before[1] > 10


def world_of(**more):
    return SimpleNamespace(
        **(
            {
                "terms": Terms(),
                "metal": None,
                "ring": SimpleNamespace(constant_light=0.1),
                "mask": np.ones((40, 40), bool),
            }
            | more
        )
    )


def test_it_is_named_and_paid_for_in_sigma():
    maps, normal = fit_of(0.5)
    fitted = SimpleNamespace(maps=maps, problem=SimpleNamespace(illumination=ring_light()))
    decision = Translucency().decide("auto", world_of(), fitted)
    assert not decision.modelled and "translucent surface of wrap 0.5" in decision.doubt
    error = angular_error_deg(maps.normal, normal)[maps.mask]
    wide = paid(maps, {NAME: decision}).normal_sigma_deg[maps.mask]
    assert np.mean(error < 3 * maps.normal_sigma_deg[maps.mask]) < 0.2 and (error < 1.5 * wide).all()
    assert paid(maps, {NAME: Decision(NAME, False, "none")}) is maps
    assert not Translucency().decide("auto", world_of(metal=0.3), fitted).doubt


def test_leds_of_several_polar_angles_tell_it_themselves():
    light = ring_light()
    axis, cosine = ring_axis(light)
    np.testing.assert_allclose(axis, AXIS, atol=1e-6)
    assert cosine == pytest.approx(COSINE)
    light.direction[0] = vectors([[0.0, 0.0, 1.0]])
    assert ring_axis(light) is None
    fitted = SimpleNamespace(maps=None, problem=SimpleNamespace(illumination=light))
    assert "polar angles" in Translucency().decide("auto", world_of(), fitted).why
