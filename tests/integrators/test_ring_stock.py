"""The ring integrator against renders of stock Mitsuba."""

import mitsuba as mi
import numpy as np
import pytest

from tests.support.ring_scenes import (
    HEIGHT,
    WIDTH,
    camera,
    diffuse,
    far,
    load,
    near,
    peak,
    plane,
    render,
    ring,
    soft,
)

RESPONSE = peak(540, power=15.0, sigma_nm=15.0)
RISING, FALLING = [(400, 1.0), (700, 3.0)], [(400, 3.0), (700, 1.0)]
LEDS = {  # spectra that the film's importance sampling of D serves well
    "led_0": far((0.7, -0.2, 1), RISING),
    "led_1": near((0.6, 0.2, 1.5), FALLING),
    "led_2": soft((1.6, 0.2, 1.9), 0.3, 1.0),
}
FLOOR_COLOUR = [(400, 0.9), (500, 0.3), (600, 0.8), (700, 0.6)]
WALL_COLOUR = [(400, 0.2), (520, 0.9), (560, 0.5), (700, 0.9)]
CORNER = {  # two planes that light each other
    "object": plane(FLOOR_COLOUR, half_width=(1, 1, 1)),
    "wall": plane(WALL_COLOUR, 90.0, at=(-1, 0, 1), half_width=(1, 1, 1)),
}


def quadrants(integrator, scene, spp, n_render=8):
    """Mean of each image quadrant, (2, 2, n_channel), and its standard error by independent renders."""
    image = [np.array(integrator.render(scene, seed=k, spp=spp), dtype=float) for k in range(n_render)]
    mean = np.array(image).reshape(n_render, 2, HEIGHT // 2, 2, WIDTH // 2, -1).mean(axis=(2, 4))
    return mean.mean(axis=0), mean.std(axis=0, ddof=1) / np.sqrt(n_render)


def assert_equals_stock(objects, leds, stock, max_depth=1, response=RESPONSE, twin=None, view=None, spp=16):
    """All quadrants of all channels agree within four standard errors, which are below 2 %.

    `twin` gives for each LED that is compared what stock renders in its place: an LED and a response with the same
    product D E. Stock's film samples D, so it is D that had better be narrow.
    """
    view, twin = view or {}, twin or {name: (led, response) for name, led in leds.items()}
    whole = load(objects | leds, camera(**view))
    mean, error = quadrants(ring(max_depth=max_depth, response=response), whole, spp)
    assert mean.shape[-1] == len(leds)
    integrator = mi.load_dict({"rr_depth": 100} | stock if stock["type"] == "path" else stock)
    unlit = {k: v | {"emitter": diffuse(0.0)} for k, v in leds.items() if "emitter" in v}
    for name, (led, seen) in twin.items():
        j = list(leds).index(name)
        scene = load(objects | unlit | {name: led}, camera(**view, response=seen))
        expected, expected_error = (np.pi * v[..., 0] for v in quadrants(integrator, scene, spp))
        assert (expected > 0).all()
        sigma = np.hypot(error[..., j], expected_error)
        assert (sigma < 0.02 * expected).all(), name
        assert (np.abs(mean[..., j] - expected) < 4 * sigma + 1e-5 * expected).all(), name


@pytest.mark.parametrize("stock", [{"type": "direct"}, {"type": "path", "max_depth": 2}])
def test_flat_spectra_on_a_plane_equal_stock_to_rounding(stock):
    leds = {"led_0": far((0.3, 0.1, 1), 2.0), "led_1": far((-1, 0, 0.5), 0.7)}
    objects = {"object": plane(0.6, 20, (1, 1, 0))}
    signal = render(load(objects | leds))
    for j, (name, led) in enumerate(leds.items()):
        scene = load(objects | {name: led}, camera(response=[(360, 1.0), (830, 1.0)]))
        expected = np.pi * np.array(mi.load_dict(stock).render(scene, spp=4))[..., 0]
        np.testing.assert_allclose(signal[..., j], expected, rtol=1e-5)


@pytest.mark.parametrize("max_depth", [1, 3])
def test_coloured_corner_equals_stock(max_depth):
    stock = {"type": "direct"} if max_depth == 1 else {"type": "path", "max_depth": max_depth + 1}
    assert_equals_stock(CORNER, LEDS, stock, max_depth)


def test_inter_reflection_of_several_bands_equals_stock():
    direction, centre_nm = (0.7, -0.2, 1), (450, 540, 620)
    leds = {f"led_{nm}": far(direction, peak(nm)) for nm in centre_nm}
    twin = {f"led_{nm}": (far(direction), peak(nm)) for nm in centre_nm}
    assert_equals_stock(CORNER, leds, {"type": "path", "max_depth": 3}, 2, response=1.0, twin=twin)


def test_two_sided_and_blended_materials_equal_stock():
    gloss = {"type": "roughconductor", "material": "none", "alpha": 0.4}
    blend = {"type": "blendbsdf", "weight": 0.3, "a": diffuse([(450, 0.2), (620, 0.9)]), "b": gloss}
    objects = {
        "object": plane(bsdf={"type": "twosided", "bsdf": blend}, angle=180.0, half_width=(1, 1, 1)),
        "wall": CORNER["wall"],
    }
    assert_equals_stock(objects, LEDS, {"type": "path", "max_depth": 3}, max_depth=2, spp=36)


def test_turned_perspective_camera_that_sees_a_light_equals_stock():
    view = {"origin": (3, -1, 9), "up": (0.3, 1, 0), "perspective": True}
    leds = LEDS | {"led_2": soft((0.8, 0, 1), 0.4, 1.0, target=(-1.2, 0, 2))}
    objects = CORNER | {"floor": plane(0.5, at=(0, 0, -0.5))}
    assert_equals_stock(objects, leds, {"type": "path", "max_depth": 3}, max_depth=2, view=view, spp=36)


def test_any_of_8_leds_equals_its_stock_render():
    azimuth = 2 * np.pi * np.arange(8) / 8
    direction = np.stack([np.cos(azimuth), np.sin(azimuth), np.ones(8)], axis=1)
    centre_nm = [405, 430, 460, 490, 525, 560, 595, 635]
    objects = {
        "object": {"type": "sphere", "bsdf": diffuse([(340, 0.2), (550, 0.5), (700, 0.8)])},
        "pole": {"type": "cylinder", "p0": [0.3, 0.9, 0.4], "p1": [0.2, 0.4, 1.6], "radius": 0.1},
    }
    leds = {f"led_{j:02d}": far(direction[j], peak(centre_nm[j])) for j in range(8)}
    twin = {f"led_{j:02d}": (far(direction[j]), peak(centre_nm[j])) for j in (0, 2, 7)}
    assert_equals_stock(objects, leds, {"type": "direct"}, response=1.0, twin=twin)
