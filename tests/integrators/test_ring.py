"""The ring integrator against stock Mitsuba, closed forms and brute force."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from evsdr.integrators.leds import emitter_id
from evsdr.integrators.ring import RingIntegrator

from tests.support.ring_scenes import (
    HEIGHT,
    LIT_SHARE,
    POWER,
    ROOF,
    SHADOW_EDGE_COLUMN,
    WIDTH,
    brute_force,
    camera,
    diffuse,
    far,
    load,
    near,
    peak,
    pixel_centres,
    plane,
    render,
    ring,
    soft,
)

# ---------------------------------------------------------------------- stock Mitsuba

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


def quadrants(integrator, scene, spp, n_render=12):
    """Mean of each image quadrant, (2, 2, n_channel), and its standard error by independent renders."""
    image = [np.array(integrator.render(scene, seed=k, spp=spp), dtype=float) for k in range(n_render)]
    mean = np.array(image).reshape(n_render, 2, HEIGHT // 2, 2, WIDTH // 2, -1).mean(axis=(2, 4))
    return mean.mean(axis=0), mean.std(axis=0, ddof=1) / np.sqrt(n_render)


def assert_equals_stock(objects, leds, stock, max_depth=1, response=RESPONSE, twin=None, view=None, spp=16):
    """All quadrants of all channels agree within four standard errors, which are below 2 %.

    `twin` gives for each LED what stock renders in its place: an LED and a response with the same product
    D E. Stock's film samples D, so it is D that had better be narrow.
    """
    view, twin = view or {}, twin or {name: (led, response) for name, led in leds.items()}
    whole = load(objects | leds, camera(**view))
    mean, error = quadrants(ring(max_depth=max_depth, response=response), whole, spp)
    assert mean.shape[-1] == len(leds)
    integrator = mi.load_dict({"rr_depth": 100} | stock if stock["type"] == "path" else stock)
    unlit = {k: v | {"emitter": diffuse(0.0)} for k, v in leds.items() if "emitter" in v}
    for j, (name, (led, seen)) in enumerate(twin.items()):
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


@pytest.mark.parametrize("max_depth", [1, 2, 3])
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


@pytest.mark.slow
def test_each_of_24_leds_equals_its_stock_render():
    azimuth = 2 * np.pi * np.arange(24) / 24
    direction = np.stack([np.cos(azimuth), np.sin(azimuth), np.ones(24)], axis=1)
    centre_nm = [405, 430, 460, 490, 525, 560, 595, 635] * 3
    objects = {
        "object": {"type": "sphere", "bsdf": diffuse([(340, 0.2), (550, 0.5), (700, 0.8)])},
        "pole": {"type": "cylinder", "p0": [0.3, 0.9, 0.4], "p1": [0.2, 0.4, 1.6], "radius": 0.1},
    }
    leds = {f"led_{j:02d}": far(direction[j], peak(centre_nm[j])) for j in range(24)}
    twin = {name: (far(direction[j]), peak(centre_nm[j])) for j, name in enumerate(leds)}
    assert_equals_stock(objects, leds, {"type": "direct"}, response=1.0, twin=twin)


# ---------------------------------------------------------------------- closed forms


@pytest.mark.parametrize("angle", [0.0, 30.0, 60.0, 80.0])
def test_tilted_white_plane_gives_the_cosine(angle):
    leds = {"led_0": far((0, 0, 1)), "led_1": far((0, 0, 1), 3.0)}
    signal = render(load({"object": plane(1.0, angle, (1, 2, 0))} | leds))
    np.testing.assert_allclose(signal[..., 0], POWER * np.cos(np.deg2rad(angle)), rtol=1e-5)
    np.testing.assert_allclose(signal[..., 1], 3 * signal[..., 0], rtol=1e-6)


def test_near_light_falls_off_with_the_square_of_distance():
    position = np.array([0.3, -0.2, 1.5])
    x, y = pixel_centres()
    distance = np.sqrt((x - position[0]) ** 2 + (y - position[1]) ** 2 + position[2] ** 2)
    signal = render(load({"object": plane(0.5), "led_0": near(position), "led_1": near(2 * position)}))
    np.testing.assert_allclose(signal[..., 0], 0.5 * POWER * position[2] / distance**3, rtol=1e-5)


def test_small_light_of_finite_size_is_a_near_light():
    half_width = 0.002
    radiance = 1 / (4 * half_width**2)
    small, point = {"led_0": soft((1, 0.5, 3), half_width, radiance)}, {"led_0": near((1, 0.5, 3))}
    object_, other = {"object": plane(angle=10.0)}, {"led_1": far((0, 0, 1))}
    # The square faces the origin; elsewhere it is seen at an angle.
    x, y = pixel_centres()
    expected = render(load(object_ | point | other))[..., 0]
    position = np.array([1, 0.5, 3])
    to_pixel = np.stack([x, y, -np.tan(np.deg2rad(10)) * x], axis=-1) - position
    facing = to_pixel @ -position / (np.linalg.norm(to_pixel, axis=-1) * np.linalg.norm(position))
    np.testing.assert_allclose(render(load(object_ | small | other))[..., 0], expected * facing, rtol=2e-3)


def test_constant_light_is_added():
    scene = load({"object": plane(), "led_0": far((1, 0, 1)), "led_1": near((0, 0, 2))})
    np.testing.assert_allclose(render(scene, constant_light=70.0) - render(scene), 70.0, rtol=1e-6)


def test_cast_shadow_leaves_exactly_the_constant_light():
    shaded = {"led_0": far((0, 0, 1)), "led_1": near((0, 0, 6)), "led_2": soft((0, 0, 6), 0.02)}
    occluder = plane(half_width=(0.2, 0.2, 1), at=(0, 0, 5))
    objects = {"object": plane(), "occluder": occluder, "led_3": far((1, 0, 1))}
    scene = load(objects | shaded, camera((9, 0, 9)))
    signal = render(scene, constant_light=0.3)[HEIGHT // 2, WIDTH // 2]
    assert (signal[:3] == np.float32(0.3)).all()
    assert signal[3] > 100


@pytest.mark.parametrize(
    ("response", "power"),
    [(0.5, 235.0), ([(400, 0), (500, 1), (600, 0)], 100.0), ([(400, 0), (500, 3), (610, 0)], 315.0)],
    ids=["number", "regular", "irregular"],
)
def test_response_scales_the_power(response, power):
    scene = load({"object": plane(), "led_0": far((0, 0, 1)), "led_1": far((0, 0, 1), 2.0)})
    np.testing.assert_allclose(render(scene, response=response)[..., 0], power, rtol=1e-5)
    np.testing.assert_allclose(render(scene, spp=4, response=response)[..., 1], 2 * power, rtol=1e-5)


def test_two_line_led():
    lines = [(449, 0), (450, 1), (451, 0), (619, 0), (620, 3), (621, 0)]
    reflectance = [(400, 0.1), (700, 0.7)]
    scene = load({"object": plane(reflectance), "led_0": far((0, 0, 1), lines), "led_1": far((0, 0, 1))})
    expected = np.interp([450, 620], [400, 700], [0.1, 0.7]) @ [1, 3]
    np.testing.assert_allclose(render(scene)[..., 0], expected, rtol=1e-5)


def test_light_that_the_camera_sees():
    leds = {
        "led_0": soft((-0.5, 0, 1), 0.3, 3.0, target=(-0.5, 0, 9)),
        "led_1": soft((0.5, 0, 1), 0.3, 5.0, target=(0.5, 0, -9)),
    }
    scene = load({"object": plane(at=(0, 0, -1))} | leds)
    front, back = (HEIGHT // 2, WIDTH // 4), (HEIGHT // 2, 3 * WIDTH // 4)
    signal = render(scene)
    np.testing.assert_allclose(signal[front], [3 * np.pi * POWER, 0], rtol=1e-5)
    np.testing.assert_array_equal(signal[back], 0)
    np.testing.assert_array_equal(render(scene, hide_emitters=True)[front], 0)


@pytest.mark.parametrize("n_led", [2, 48])
def test_number_of_leds(n_led):
    leds = {f"led_{j}": far((0, 0, 1), 1.0 + j) for j in range(n_led)}
    signal = render(load({"object": plane()} | leds))
    expected = POWER * np.arange(1.0, n_led + 1)
    np.testing.assert_allclose(signal, np.broadcast_to(expected, signal.shape), rtol=1e-5)


# ---------------------------------------------------------------------- which channel is which


def test_leds_are_ordered_by_natural_id_and_others_left_out():
    power = {"led_10": 5.0, "led_2": 3.0, "sun": 100.0, "led_01": 2.0, "led_33": 7.0}
    emitters = {name: far((0, 0, 1), p) for name, p in power.items()}
    scene = load({"led_9": soft((0, 0, 5), 0.1), "object": plane(), "led_0": soft((0, 1, 5), 0.1)} | emitters)
    integrator = ring()
    order = ["led_0", "led_01", "led_2", "led_9", "led_10", "led_33"]
    assert [emitter_id(e) for e in integrator.leds(scene).emitter] == order
    signal = np.array(integrator.render(scene, spp=1))[0, 0] / POWER
    np.testing.assert_allclose(signal[[1, 2, 4, 5]], [2, 3, 5, 7], rtol=1e-5)
    assert (signal[[0, 3]] < 0.01).all()


def test_bands():
    spectra = [peak(525), peak(525, 3.0), peak(460, 2.0), peak(527, 4.0), peak(460, 0.1)]
    scene = load({"object": plane()} | {f"led_{j}": far((0, 0, 1), s) for j, s in enumerate(spectra)})
    leds = ring().leds(scene)
    assert leds.band.tolist() == [0, 0, 1, 2, 1]
    np.testing.assert_allclose(leds.power, [1, 3, 2, 4, 0.1], rtol=1e-4)
    np.testing.assert_allclose(leds.band_wavelength_nm, [525, 460, 527], atol=0.01)


def test_power_of_near_and_soft_leds():
    leds = {"led_0": near((9, 0, 5), peak(500, 2.0)), "led_1": soft((1, 0, 5), 0.1, peak(600, 4.0))}
    found = ring(response=[(400, 0.5), (700, 0.5)]).leds(load({"object": plane()} | leds))
    np.testing.assert_allclose(found.power, [1, 2], rtol=1e-4)
    assert [found.is_far(0), found.is_far(1)] == [False, False]


# ---------------------------------------------------------------------- pixel area


def test_pixel_on_a_shadow_edge_is_lit_by_its_share():
    scene = load(ROOF | {"led_0": far((-1, 0, 1)), "led_1": far((1, 0, 1))}, camera(half_width=2.0))
    share = render(scene, spp=64)[..., 0] / (POWER * np.cos(np.deg2rad(45)))
    edge = share[:, SHADOW_EDGE_COLUMN]
    assert np.abs(edge - LIT_SHARE).max() < 0.1
    assert np.mean(edge) == pytest.approx(LIT_SHARE, abs=0.02)
    np.testing.assert_allclose(share[:, SHADOW_EDGE_COLUMN + 1 :], 1, rtol=1e-5)
    np.testing.assert_array_equal(share[:, 10:SHADOW_EDGE_COLUMN], 0)


def test_soft_shadow_against_brute_force():
    position, half_width = (-3.0, 0.4, 4.0), 0.5
    leds = {"led_0": soft(position, half_width), "led_1": far((0, 0, 1))}
    scene = load(ROOF | leds, camera(half_width=2.0))
    signal = render(scene, spp=1024)[..., 0] / POWER
    x, y = pixel_centres(2.0)
    fraction = []
    for row, column in [(6, c) for c in range(10, 16)] + [(2, 12), (9, 13)]:
        expected, unshadowed = 0.0, 0.0
        for dx in np.linspace(-0.1, 0.1, 5):  # fifths of a pixel
            surface_point = np.array([x[row, column] + dx, y[row, column], 0])
            point, direction, given = brute_force(surface_point, position, half_width)
            at_roof = surface_point[0] + (point[:, 0] - surface_point[0]) / point[:, 2]
            cosine = given * direction[:, 2]
            expected, unshadowed = expected + cosine @ (at_roof > 0.3) / 5, unshadowed + cosine.sum() / 5
        fraction.append(expected / unshadowed)
        assert signal[row, column] == pytest.approx(expected, abs=0.03 * unshadowed)
    assert sum(0.05 < f < 0.95 for f in fraction) >= 3


def test_seeds():
    scene = load(ROOF | {"led_0": soft((-3, 0.4, 4), 0.5), "led_1": far((0, 0, 1))}, camera(half_width=2.0))
    one, same, other = (render(scene, spp=4, seed=seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, same)
    assert np.mean(one[..., 0] != other[..., 0]) > 0.4


def test_crop_window_is_a_part_of_the_image():
    leds = {"led_0": near((1, 0.5, 2)), "led_1": far((1, 1, 1))}
    objects = {"object": {"type": "sphere"}} | leds
    crop = {"crop_offset_x": 3, "crop_offset_y": 2, "crop_width": 7, "crop_height": 5}
    whole = render(load(objects))
    part = render(load(objects, camera(**crop)))
    np.testing.assert_allclose(part, whole[2:7, 3:10], rtol=1e-3, atol=1e-3)
    assert np.ptp(part[..., 0]) > 0.1 * POWER


# ---------------------------------------------------------------------- loading


def test_loads_by_name_from_xml():
    scene = mi.load_string(
        """<scene version="3.0.0">
            <integrator type="ring">
                <float name="constant_light" value="0.25"/>
                <integer name="max_depth" value="2"/>
                <spectrum name="response" value="360:0, 500:1, 640:0"/>
            </integrator>
            <sensor type="orthographic" id="camera">
                <film type="hdrfilm">
                    <integer name="width" value="4"/> <integer name="height" value="3"/>
                </film>
                <sampler type="independent"> <integer name="sample_count" value="1"/> </sampler>
            </sensor>
            <emitter type="directional" id="led_00">
                <vector name="direction" value="0, 0, 1"/> <spectrum name="irradiance" value="1"/>
            </emitter>
            <emitter type="directional" id="led_01">
                <vector name="direction" value="0, 0, 1"/> <spectrum name="irradiance" value="2"/>
            </emitter>
            <shape type="rectangle" id="object">
                <transform name="to_world">
                    <scale value="5"/> <rotate x="1" angle="180"/> <translate z="1"/>
                </transform>
                <bsdf type="diffuse"> <spectrum name="reflectance" value="0.5"/> </bsdf>
            </shape>
        </scene>"""
    )
    integrator = scene.integrator()
    assert isinstance(integrator, RingIntegrator)
    assert integrator.max_depth == 2
    signal = np.array(mi.render(scene))
    np.testing.assert_allclose(signal, np.broadcast_to([70.25, 140.25], (3, 4, 2)), rtol=1e-5)


def test_bad_max_depth_is_a_sentence():
    with pytest.raises(RuntimeError, match="max_depth must be at least 1, got 0"):
        ring(max_depth=0)


def test_unknown_parameter_is_named():
    with pytest.raises(RuntimeError, match="constant_lihgt"):
        ring(constant_lihgt=1.0)


def test_scene_without_leds():
    with pytest.raises(ValueError, match="no emitter has an id that starts with 'led'"):
        render(load({"object": plane(), "sun": far((0, 0, 1))}))


def test_led_that_the_camera_cannot_see():
    scene = load({"object": plane(), "led_0": far((0, 0, 1)), "led_1": far((0, 0, 1), peak(750))})
    with pytest.raises(ValueError, match="'led_1' gives the camera no light"):
        render(scene, response=[(400, 1.0), (650, 1.0)])


def test_scene_without_an_object():
    scene = load({"thing": plane(), "led_0": far((0, 0, 1)), "led_1": far((1, 0, 1))})
    with pytest.raises(ValueError, match="no shape has the id 'object'"):
        ring().illumination(scene, scene.sensors()[0], 1)


def test_new_values_need_no_new_kernel():
    scene = load(ROOF | {"led_0": soft((-3, 0.4, 4), 0.5), "led_1": far((0, 0, 1))})
    integrator = ring()
    params = mi.traverse(integrator)
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
        for value in range(4):
            if value == 2:
                dr.kernel_history_clear()
            params["constant_light"] = mi.Float(0.1 + value)
            params.update()
            integrator.render(scene, seed=value, spp=4)
        kernels = [k for k in dr.kernel_history() if k["type"] == dr.KernelType.JIT]
    assert kernels and all(k["cache_hit"] for k in kernels)
