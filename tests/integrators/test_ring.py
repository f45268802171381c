"""The ring integrator against closed forms and brute force; how it is loaded."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
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
    far,
    load,
    near,
    pixel_centres,
    plane,
    render,
    ring,
    soft,
)

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


@pytest.mark.parametrize("n_led", [2, 11, 48])
def test_number_of_leds(n_led):
    leds = {f"led_{j}": far((0, 0, 1), 1.0 + j) for j in range(n_led)}
    signal = render(load({"object": plane()} | leds))
    expected = POWER * np.arange(1.0, n_led + 1)
    np.testing.assert_allclose(signal, np.broadcast_to(expected, signal.shape), rtol=1e-5)


def test_a_kernel_for_many_leds_is_as_short_as_for_some():
    """LLVM would take minutes for one that holds hundreds one by one."""

    def rendered(n_led):
        leds = {f"led_{j}": far((0, 0.01 * j, 1), 1.0 + j) for j in range(n_led)}
        scene = load({"object": plane(0.3)} | leds)
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
            dr.kernel_history()
            image = render(scene, spp=4)
            return image, max(kernel.get("operation_count", 0) for kernel in dr.kernel_history())

    (some, short), (many, long) = rendered(16), rendered(64)
    np.testing.assert_array_equal(many[..., :16], some)
    assert 100 < long < 1.05 * short


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


def test_unit_is_one_of_length():
    assert (ring().unit, ring(unit="mm").unit) == ("", "mm")
    with pytest.raises(RuntimeError, match="unit must be one of um, mm, cm, m, got inch"):
        ring(unit="inch")


def test_bad_max_depth_is_a_sentence():
    with pytest.raises(RuntimeError, match="max_depth must be at least 1, got 0"):
        ring(max_depth=0)


def test_unknown_parameter_is_named():
    with pytest.raises(RuntimeError, match="constant_lihgt"):
        ring(constant_lihgt=1.0)


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


def test_the_size_of_another_scene_is_not_in_the_kernel():
    """Each recording with a surface of its own would compile one, as LEDs that are far know how large their scene is."""
    scene = load({"object": plane(0.3)} | {f"led_{j}": far((0, 0.1 * j, 1)) for j in range(11)})
    integrator, other = ring(), None
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
        for half_width in (30, 40):
            other = None  # how many there are is in the kernel
            other = load({"object": plane(half_width=(half_width, 20, 1)), "led_0": far((0, 0, 1))})
            dr.kernel_history_clear()
            integrator.render(scene, spp=4)
        kernels = [k for k in dr.kernel_history() if k["type"] == dr.KernelType.JIT]
    assert other and kernels and all(k["cache_hit"] for k in kernels)
