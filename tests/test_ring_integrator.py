"""The ring integrator against stock Mitsuba, closed forms, brute force and finite differences."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from evsdr.experiments.gradients import compare
from evsdr.integrators.leds import emitter_id
from evsdr.integrators.ring import RingIntegrator, camera_frame

POWER = 470.0  # INT dlambda of a flat spectrum of 1, over Mitsuba's 360 to 830 nm
WIDTH, HEIGHT = 16, 12


# ---------------------------------------------------------------------- scenes


def spectrum(value) -> dict:
    """A number, or pairs (wavelength, value)."""
    return {"type": "spectrum", "value": value}


def peak(centre_nm, power=1.0, sigma_nm=10.0):
    nm = np.arange(centre_nm - 5 * sigma_nm, centre_nm + 5.1 * sigma_nm, sigma_nm / 2)
    density = np.exp(-0.5 * ((nm - centre_nm) / sigma_nm) ** 2)
    return list(zip(nm.tolist(), (power * density / np.trapezoid(density, nm)).tolist()))


def diffuse(reflectance=1.0):
    return {"type": "diffuse", "reflectance": spectrum(reflectance)}


def far(to_light, irradiance=1.0):
    direction = (-np.array(to_light, float)).tolist()
    return {"type": "directional", "direction": direction, "irradiance": spectrum(irradiance)}


def near(position, intensity=1.0):
    return {"type": "point", "position": list(position), "intensity": spectrum(intensity)}


def soft(position, half_width, radiance=1.0, target=(0, 0, 0)):
    """A square light that faces the target."""
    transform = mi.ScalarTransform4f
    to_world = transform().look_at(list(position), list(target), [0.1, 1, 0.2])
    light = {"type": "area", "radiance": spectrum(radiance)}
    return {"type": "rectangle", "to_world": to_world @ transform().scale(half_width), "emitter": light}


def plane(reflectance=1.0, angle=0.0, axis=(0, 1, 0), at=(0, 0, 0), half_width=(20, 20, 1), bsdf=None):
    transform = mi.ScalarTransform4f
    turn = transform().rotate((np.array(axis) / np.linalg.norm(axis)).tolist(), angle)
    to_world = transform().translate(list(at)) @ turn @ transform().scale(list(half_width))
    return {"type": "rectangle", "to_world": to_world, "bsdf": bsdf or diffuse(reflectance)}


def camera(origin=(0, 0, 10), up=(0, 1, 0), half_width=1.0, response=None, perspective=False, **film):
    """A camera that looks at the world's origin; with a response its film holds INT D L dlambda."""
    transform = mi.ScalarTransform4f
    to_world = transform().look_at(list(origin), [0, 0, 0], list(up))
    film = {"type": "hdrfilm", "width": WIDTH, "height": HEIGHT, "rfilter": {"type": "box"}} | film
    if response is not None:
        film |= {"type": "specfilm", "band": spectrum(response)}
    if perspective:
        return {"type": "perspective", "fov": 12, "to_world": to_world, "film": film}
    to_world = to_world @ transform().scale([half_width, half_width, 1])
    return {"type": "orthographic", "to_world": to_world, "film": film}


def load(objects, view=None):
    return mi.load_dict({"type": "scene", "camera": view or camera()} | objects, optimize=False)


def ring(**parameters):
    parameters = {k: spectrum(v) if k == "response" else v for k, v in parameters.items()}
    return mi.load_dict({"type": "ring"} | parameters)


def render(scene, spp=1, seed=0, **parameters):
    return np.array(ring(**parameters).render(scene, spp=spp, seed=seed), dtype=float)


def pixel_centres(half_width=1.0):
    """x and y (H, W) in the camera frame."""
    x = ((np.arange(WIDTH) + 0.5) / WIDTH * 2 - 1) * half_width
    y = -((np.arange(HEIGHT) + 0.5) / HEIGHT * 2 - 1) * half_width * HEIGHT / WIDTH
    return np.meshgrid(x, y)


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


# ---------------------------------------------------------------------- inverse: image-space textures

BALL = {
    "object": {"type": "sphere", "bsdf": diffuse([(400, 0.1), (700, 0.7)])},
    "led_0": far((1, 0.2, 1), peak(460, 2.0)),
    "led_1": near((-1, 1, 2.5), peak(600, 5.0)),
    "led_2": far((0, -1, 0.8), peak(600, 1.0)),
}
POLE = {"pole": {"type": "cylinder", "p0": [0.8, 0.3, 0.5], "p1": [0.4, 0.2, 1.6], "radius": 0.15}}


def set_textures(integrator, **value):
    params = mi.traverse(integrator)
    for name, array in value.items():
        params[name] = mi.TensorXf(np.ascontiguousarray(array, np.float32))
    params.update()


def ball_normals():
    """A ball looks the same from everywhere: normals (H, W, 3) in the camera frame and where it is."""
    x, y = pixel_centres()
    z2 = 1 - x**2 - y**2
    return np.stack([x, y, np.sqrt(np.maximum(z2, 0))], axis=-1), z2 > 0


def test_textures_are_traversed():
    assert set(mi.traverse(ring()).keys()) == {"constant_light", "normal", "reflectance"}


@pytest.mark.parametrize("shadow", [False, True], ids=["lit", "shadow"])
@pytest.mark.parametrize("turned", [False, True], ids=["frontal", "turned"])
def test_true_textures_render_the_scene(shadow, turned):
    view = camera((4, 2, 8), (0.2, 1, 0.1)) if turned else camera()
    scene = load(BALL | (POLE if shadow else {}), view)
    integrator = ring(constant_light=0.05)
    forward = np.array(integrator.render(scene, spp=1))
    normal, on_ball = ball_normals()
    seen = np.array(integrator.illumination(scene, scene.sensors()[0], 1)[1]).reshape(on_ball.shape) == 1
    assert (on_ball & ~seen).any() == shadow
    reflectance = np.broadcast_to(np.interp([460, 600], [400, 700], [0.1, 0.7]), (HEIGHT, WIDTH, 2))
    set_textures(integrator, normal=3.0 * normal, reflectance=reflectance)
    textured = np.array(integrator.render(scene, spp=1))
    np.testing.assert_allclose(textured[seen], forward[seen], rtol=1e-4, atol=1e-5)
    np.testing.assert_array_equal(textured[~seen], np.float32(0.05))
    unlit = (forward == np.float32(0.05))[seen]
    assert unlit.any() and not unlit.all()


def test_another_scene_is_traced_anew():
    integrator = ring()
    normal, _ = ball_normals()
    set_textures(integrator, normal=normal + [0, 0, 0.1], reflectance=np.ones((HEIGHT, WIDTH, 2)))
    lit, shaded = load(BALL), load(BALL | POLE)
    one, other, again = (np.array(integrator.render(scene, spp=1)) for scene in (lit, shaded, lit))
    assert np.sum(one) > 1.01 * np.sum(other)
    np.testing.assert_array_equal(one, again)
    assert (np.array(integrator.render(lit, spp=4)) != one).any()
    dim = load(BALL | {"led_2": far((0, -1, 0.8), peak(600, 0.5))})
    np.testing.assert_allclose(np.array(integrator.render(dim, spp=1))[..., 2], 0.5 * one[..., 2], rtol=1e-5)


def test_normals_that_face_away_give_no_signal():
    scene = load({"object": plane(), "led_0": far((1, 0, 1)), "led_1": near((5, 0, 3))})
    integrator = ring(constant_light=0.05)
    normal = np.broadcast_to([-1, 0, 0.5], (HEIGHT, WIDTH, 3))
    set_textures(integrator, normal=normal, reflectance=np.ones((HEIGHT, WIDTH, 1)))
    np.testing.assert_array_equal(np.array(integrator.render(scene, spp=1)), np.float32(0.05))


def test_normal_of_length_zero_gives_no_signal():
    scene = load(BALL)
    integrator = ring(constant_light=0.05)
    none = np.zeros((HEIGHT, WIDTH, 3))
    set_textures(integrator, normal=none, reflectance=np.ones((HEIGHT, WIDTH, 2)))
    np.testing.assert_array_equal(np.array(integrator.render(scene, spp=1)), np.float32(0.05))


@pytest.mark.parametrize("shape", [(HEIGHT, WIDTH, 3), (HEIGHT, WIDTH - 1, 2)])
def test_textures_of_the_wrong_shape(shape):
    integrator = ring()
    set_textures(integrator, normal=np.ones((HEIGHT, WIDTH, 3)), reflectance=np.ones(shape))
    with pytest.raises(ValueError, match=r"reflectance \(H, W, 2\), got \(12, 16, 3\) and"):
        integrator.render(load(BALL), spp=1)


def test_gradients_equal_finite_differences():
    checks = compare(size=24)
    assert {(c.parameter, c.route) for c in checks} == {
        (parameter, route)
        for parameter in ("normal", "reflectance", "constant_light")
        for route in ("dr.backward", "render_backward")
    }
    for check in checks:
        bound = 2e-3 if check.parameter == "normal" else 1e-3
        assert np.count_nonzero(check.finite) > 0.2 * len(check.finite)
        assert check.relative_error <= bound, check.parameter
        assert check.largest_error <= bound, check.parameter


def test_rendering_keeps_no_scene_alive():
    freed = []

    class Watched(RingIntegrator):
        def __del__(self):
            freed.append(1)

    mi.register_integrator("watched_ring", lambda props: Watched(props))
    scene = load(BALL | {"integrator": {"type": "watched_ring"}})
    ones = np.ones((HEIGHT, WIDTH, 3))
    set_textures(scene.integrator(), normal=ones, reflectance=ones[..., :2])
    scene.integrator().render(scene, spp=1)
    del scene
    assert freed == [1]


# ---------------------------------------------------------------------- pixel area

# A roof at height 1 hides x < 0.3 from the camera; light from the left draws its shadow's edge at x = 1.3.
ROOF = {"object": plane(), "roof": plane(at=(-9.7, 0, 1), half_width=(10, 20, 1))}
SHADOW_EDGE_COLUMN, LIT_SHARE = 13, 0.8  # pixel from x = 1.25 to 1.5 where the view is 4 wide


def test_pixel_on_a_shadow_edge_is_lit_by_its_share():
    scene = load(ROOF | {"led_0": far((-1, 0, 1)), "led_1": far((1, 0, 1))}, camera(half_width=2.0))
    share = render(scene, spp=64)[..., 0] / (POWER * np.cos(np.deg2rad(45)))
    edge = share[:, SHADOW_EDGE_COLUMN]
    assert np.abs(edge - LIT_SHARE).max() < 0.1
    assert np.mean(edge) == pytest.approx(LIT_SHARE, abs=0.02)
    np.testing.assert_allclose(share[:, SHADOW_EDGE_COLUMN + 1 :], 1, rtol=1e-5)
    np.testing.assert_array_equal(share[:, 10:SHADOW_EDGE_COLUMN], 0)


def square_points(position, half_width, n=60):
    """Points (n * n, 3) on the square light that faces the origin, and its normal."""
    matrix = np.array(soft(position, half_width)["to_world"].matrix, dtype=float)
    u = (np.arange(n) + 0.5) / n * 2 - 1
    grid = np.stack([*np.meshgrid(u, u), np.zeros((n, n)), np.ones((n, n))], axis=-1).reshape(-1, 4)
    return (grid @ matrix.T)[:, :3], -np.array(position) / np.linalg.norm(position)


def brute_force(surface_point, position, half_width):
    """Points of a square light of radiance 1: where (n, 3), in what direction (n, 3), dA cos / d^2 (n)."""
    point, light_normal = square_points(position, half_width)
    to_light = point - surface_point
    distance = np.linalg.norm(to_light, axis=1, keepdims=True)
    direction = to_light / distance
    area = (2 * half_width) ** 2
    return point, direction, -(direction @ light_normal) * area / len(point) / distance[:, 0] ** 2


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


# ---------------------------------------------------------------------- illumination


def illumination(objects, view=None, spp=1, shadows=True):
    """Directions (n_led, H, W, 3), irradiances (n_led, H, W) and coverage (H, W)."""
    scene = load(objects, view)
    light, coverage = ring().illumination(scene, scene.sensors()[0], spp, 0, shadows)
    n_pixel = HEIGHT * WIDTH
    direction = np.array([np.broadcast_to(np.array(d, float).T, (n_pixel, 3)) for d in light.direction])
    irradiance = np.array([np.broadcast_to(np.array(e, float), n_pixel) for e in light.irradiance])
    coverage = np.array(coverage, float).reshape(HEIGHT, WIDTH)
    return direction.reshape(-1, HEIGHT, WIDTH, 3), irradiance.reshape(-1, HEIGHT, WIDTH), coverage


def test_far_irradiance_is_power_times_visibility():
    leds = {"led_0": far((-1, 0, 1), 3.0), "led_1": far((1, 2, 1), 0.5)}
    direction, irradiance, coverage = illumination(ROOF | leds, camera(half_width=2.0), spp=64)
    assert np.mean(irradiance[0, :, SHADOW_EDGE_COLUMN]) == pytest.approx(3 * POWER * LIT_SHARE, rel=0.02)
    assert (irradiance[0, :, 10:SHADOW_EDGE_COLUMN] == 0).all()
    np.testing.assert_allclose(irradiance[0, :, SHADOW_EDGE_COLUMN + 1 :], 3 * POWER, rtol=1e-5)
    np.testing.assert_allclose(irradiance[1][coverage > 0], 0.5 * POWER, rtol=1e-5)
    np.testing.assert_allclose(direction[0] - [-1 / np.sqrt(2), 0, 1 / np.sqrt(2)], 0, atol=1e-6)
    # The roof's edge at x = 0.3 lies in the pixel from 0.25 to 0.5.
    assert (coverage[:, :9] == 0).all()
    assert np.mean(coverage[:, 9]) == pytest.approx(0.8, abs=0.02)
    assert (coverage[:, 10:] == 1).all()
    assert (irradiance[:, :, :9] == 0).all()


def test_shadows_can_be_left_out():
    leds = {"led_0": far((-1, 0, 1), 3.0), "led_1": near((-3, 0, 6))}
    objects, view = ROOF | leds, camera(half_width=2.0)
    with_shadow = illumination(objects, view, spp=16)[1]
    without = illumination(objects, view, spp=16, shadows=False)[1]
    np.testing.assert_allclose(without[0], 3 * POWER, rtol=1e-5)
    assert (without[:, :, 10:] > 0).all()
    assert (with_shadow[1, :, 10] == 0).all()
    np.testing.assert_allclose(with_shadow[1, :, 15], without[1, :, 15], rtol=1e-5)


def test_near_direction_and_irradiance():
    position = np.array([0.3, -0.2, 1.5])
    x, y = pixel_centres()
    to_light = position - np.stack([x, y, np.zeros_like(x)], axis=-1)
    distance = np.linalg.norm(to_light, axis=-1)
    objects = {"object": plane(), "led_0": near(position), "led_1": near((0, 0, 1))}
    direction, irradiance, _ = illumination(objects)
    np.testing.assert_allclose(direction[0], to_light / distance[..., None], atol=1e-5)
    np.testing.assert_allclose(irradiance[0], POWER / distance**2, rtol=1e-5)


def test_soft_direction_and_irradiance_against_brute_force():
    position, half_width = (-2.0, 0.4, 2.0), 0.4
    objects = {"object": plane(), "led_0": soft(position, half_width), "led_1": far((0, 0, 1))}
    direction, irradiance, _ = illumination(objects)
    x, y = pixel_centres()
    for row, column in [(0, 0), (6, 8), (11, 15)]:
        _, to_light, given = brute_force(np.array([x[row, column], y[row, column], 0]), position, half_width)
        mean = given @ to_light
        expected = mean / np.linalg.norm(mean)
        np.testing.assert_allclose(direction[0, row, column], expected, atol=1e-3)
        assert irradiance[0, row, column] == pytest.approx(POWER * np.linalg.norm(mean), rel=2e-3)


def test_directions_turn_with_the_camera():
    origin, up, position = np.array([4.0, 2.0, 8.0]), np.array([0.2, 1.0, 0.1]), np.array([1.0, -2.0, 3.0])
    toward_camera = origin / np.linalg.norm(origin)
    right = np.cross(up, toward_camera)
    right /= np.linalg.norm(right)
    frame = np.array([right, np.cross(toward_camera, right), toward_camera])
    view = camera(origin, up)
    objects = {"object": {"type": "sphere"}, "led_0": far(position), "led_1": near(position)}
    np.testing.assert_allclose(camera_frame(load(objects, view).sensors()[0]), frame, atol=1e-6)

    direction, _, coverage = illumination(objects, view, shadows=False)
    np.testing.assert_allclose(direction[0, 0, 0], frame @ position / np.linalg.norm(position), atol=1e-6)
    normal, on_ball = ball_normals()
    to_light = frame @ position - normal
    to_light /= np.linalg.norm(to_light, axis=-1, keepdims=True)
    np.testing.assert_array_equal(coverage == 1, on_ball)
    np.testing.assert_allclose(direction[1][on_ball], to_light[on_ball], atol=1e-4)


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
