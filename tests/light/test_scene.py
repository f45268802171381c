"""What is wrong with a scene.xml is said in one sentence that names file, field and remedy."""

import re

import numpy as np
import pytest

from evsdr.errors import InputError
from evsdr.light.ground_truth import object_depth
from evsdr.light.scene import load_scene, move_object, with_object
from tests.support.small_scene import HEIGHT, RING, SPHERE, WIDTH, camera, leds, scene

IN_RING = RING.replace("</integrator>", "{}</integrator>").format


def refused(tmp_path, text, **define):
    """Load a scene that can't be used and give the sentence."""
    path = tmp_path / "scene.xml"
    if isinstance(text, bytes):
        path.write_bytes(text)
    else:
        path.write_text(text)
    with pytest.raises(InputError) as caught:
        load_scene(path, define)
    sentence = str(caught.value)
    assert re.fullmatch(rf"{re.escape(str(path))}: \S.*[^.!]\.", sentence)  # one line
    assert not re.search(r"Traceback|\.py|\.cpp|Error:", sentence)
    return sentence


@pytest.mark.parametrize(
    "text",
    [
        "",
        "hello",
        b"\x00\xff\xfe binary",
        scene()[:500],
        scene().replace("</scene>", ""),
        scene().replace('version="3.0.0"', ""),
        scene().replace('id="camera"', 'id="camera'),
        scene().replace("sensor", "sensors"),
    ],
)
def test_broken_file(tmp_path, text):
    assert "Mitsuba can't load it" in refused(tmp_path, text)


def test_missing_file(tmp_path):
    with pytest.raises(InputError, match=r"scene\.xml: no such file; give the path of a scene\.xml\."):
        load_scene(tmp_path / "scene.xml")
    with pytest.raises(InputError, match="this is a folder; name a scene.xml"):
        load_scene(tmp_path)


@pytest.mark.parametrize(
    "text, words",
    [
        (scene(shape='<shape type="spheroid" id="object"/>'), 'shape plugin of type "spheroid"'),
        (scene(shape=SPHERE + '<include filename="ring24.xml"/>'), '"ring24.xml" not found'),
        (
            scene(shape='<shape type="ply" id="object"><string name="filename" value="a.ply"/></shape>'),
            '"a.ply"',
        ),
        (scene(shape=SPHERE.replace("<bsdf", '<float name="size" value="2"/><bsdf')), '"size": 2'),
        (scene(shape=SPHERE + SPHERE), 'duplicate ID: "object"'),
        (scene(light=leds(2) + leds(2)), 'duplicate ID: "led_000"'),
        (scene(shape=SPHERE.replace("<bsdf", '<float name="radius" value="$size"/><bsdf')), "$size"),
        (scene(integrator=IN_RING('<float name="constant_ligth" value="1"/>')), '"constant_ligth"'),
        (
            scene(integrator=IN_RING('<integer name="max_depth" value="0"/>')),
            "max_depth must be at least 1, got 0",
        ),
        (
            scene(integrator=IN_RING('<integer name="max_depth" value="-2"/>')),
            "max_depth must be at least 1, got -2",
        ),
        (scene(integrator=IN_RING('<string name="max_depth" value="many"/>')), 'plugin of type "ring"'),
        (
            scene(
                integrator='<integrator type="ring"><string name="constant_light" value="dim"/></integrator>'
            ),
            '"ring"',
        ),
    ],
)
def test_what_mitsuba_says_is_passed_on(tmp_path, text, words):
    sentence = refused(tmp_path, text)
    assert words in sentence
    assert sentence.endswith("; correct the file, or what -D sets in it.")


@pytest.mark.parametrize(
    "text, sentence",
    [
        ('<bsdf version="3.0.0" type="diffuse"/>', "it is not a scene; its root element must be <scene>."),
        (
            scene(integrator='<integrator type="path"/>'),
            'its integrator is not the ring; write <integrator type="ring">.',
        ),
        (scene(integrator=""), 'its integrator is not the ring; write <integrator type="ring">.'),
        (scene(sensor=""), 'no sensor has id="camera"; add one, orthographic or perspective.'),
        (
            scene(sensor=camera("left") + camera("right")),
            'no sensor has id="camera"; add one, orthographic or perspective.',
        ),
        (
            scene(sensor=camera(kind="radiancemeter", width=1, height=1)),
            'the sensor "camera" must be orthographic or perspective; change its type.',
        ),
        (scene(sensor=camera(width=0)), "the film is 0 x 12 pixels; make it as large as the sensor."),
        (
            scene(integrator=IN_RING('<float name="max_depth" value="1.5"/>')),
            "max_depth is 1.5; it must be an integer, 1 or more.",
        ),
        (
            scene(light=""),
            "no emitter has an id that starts with 'led'; see scenes/README.md for a scene that works.",
        ),
        (
            scene(light=leds(3).replace("led_", "lamp_")),
            "no emitter has an id that starts with 'led'; see scenes/README.md for a scene that works.",
        ),
        (
            scene(light=leds(1)),
            "the number of LEDs is 1; write 2 to 256, led_00, led_01 and so on.",
        ),
        (
            scene(light=leds(257)),
            "the number of LEDs is 257; write 2 to 256, led_00, led_01 and so on.",
        ),
        (
            scene(light=leds(3, ("blue", "red", "ultraviolet"))),
            "emitter 'led_002' gives the camera no light between 360 and 830 nm; "
            "see scenes/README.md for a scene that works.",
        ),
        (
            scene(integrator=IN_RING('<spectrum name="response" value="400:0, 450:1, 500:0"/>')),
            "emitter 'led_001' gives the camera no light between 360 and 830 nm; "
            "see scenes/README.md for a scene that works.",
        ),
        (
            scene(shape=SPHERE.replace("object", "thing")),
            "no shape has the id 'object'; see scenes/README.md for a scene that works.",
        ),
        (scene(shape=""), "no shape has the id 'object'; see scenes/README.md for a scene that works."),
    ],
)
def test_what_is_missing_or_wrong(tmp_path, text, sentence):
    assert refused(tmp_path, text) == f"{tmp_path / 'scene.xml'}: {sentence}"


@pytest.mark.parametrize("value", ["-1", "-1e-9", "nan", "inf"])
def test_bad_constant_light(tmp_path, value):
    assert "constant_light is " in refused(tmp_path, scene(), constant_light=value)


@pytest.mark.parametrize("define", [{"colour": "7"}, {"colour": "7", "size": "3"}, {"constant_light": "dim"}])
def test_bad_definition(tmp_path, define):
    sentence = refused(tmp_path, scene(), **define)
    assert all(word in sentence for word in (define if "colour" in define else ["dim"]))


def test_good_scene(tmp_path):
    (tmp_path / "scene.xml").write_text(scene())
    ring = load_scene(tmp_path / "scene.xml", {"constant_light": "0.125"})
    assert (ring.height, ring.width, ring.constant_light) == (HEIGHT, WIDTH, 0.125)
    assert (ring.leds.n_led, ring.leds.n_band) == (8, 2)
    assert not ring.is_near and ring.shape_is_known


def test_one_camera_needs_no_name(tmp_path):
    (tmp_path / "scene.xml").write_text(scene(sensor=camera("eye")))
    assert load_scene(tmp_path / "scene.xml").sensor.id() == "eye"


def test_the_named_camera_of_two_is_taken(tmp_path):
    (tmp_path / "scene.xml").write_text(scene(sensor=camera("eye", width=5) + camera()))
    ring = load_scene(tmp_path / "scene.xml")
    assert (ring.sensor.id(), ring.width) == ("camera", WIDTH)


def test_rectangle_is_an_unknown_shape(tmp_path):
    (tmp_path / "scene.xml").write_text(scene(shape='<shape type="rectangle" id="object"/>'))
    assert not load_scene(tmp_path / "scene.xml").shape_is_known


def test_a_mesh_takes_the_place_of_the_object(tmp_path):
    """Occluder, LEDs, camera and ring stay under their names; then the mesh moves."""
    ball = SPHERE.replace('id="object"', 'id="ball"').replace(
        "<bsdf", '<point name="center" x="9" y="0" z="0"/><bsdf'
    )
    (tmp_path / "scene.xml").write_text(scene(shape=SPHERE + ball))
    ring = load_scene(tmp_path / "scene.xml")
    corner, face = np.array([[-1, -1, 0.5], [1, -1, 0.5], [0, 1, 0.5]]), np.array([[0, 1, 2]])
    other = with_object(ring, corner, face)
    assert sorted(s.id() for s in other.scene.shapes()) == ["ball", "object"]
    assert (other.leds.n_led, other.scene.sensors()[0].id()) == (8, "camera")
    np.testing.assert_array_equal(other.leds.band, ring.leds.band)
    np.testing.assert_allclose(other.leds.power, ring.leds.power)
    depth = object_depth(other)
    assert depth.max() == pytest.approx(3.5) and 0 < np.count_nonzero(depth) < depth.size / 2
    move_object(other, corner - [0, 0, 1], face)
    assert object_depth(other).max() == pytest.approx(4.5)
    assert object_depth(ring).max() < 4.1


@pytest.mark.parametrize(
    "text, sentence",
    [
        (scene(sensor=camera(width=20_000, height=20_000)), "a film of 20000 x 20000 pixels would need "),
        (
            scene(integrator=IN_RING('<integer name="max_depth" value="1000000000"/>')),
            "max_depth is 1e+09; it must be an integer, 16 at most.",
        ),
        (
            scene(integrator=IN_RING('<float name="max_depth" value="nan"/>')),
            "max_depth is nan; it must be an integer",
        ),
        (
            scene(light=leds().replace('x="-0.707107" y="-0.000000" z="-0.707107"', 'x="0" y="0" z="0"', 1)),
            "emitter 'led_000' has a direction or position that is 0 or not finite; correct it.",
        ),
        (
            scene(light=leds().replace('x="-0.707107"', 'x="nan"', 1)),
            "emitter 'led_000' has a direction or position that is 0 or not finite; correct it.",
        ),
        (
            scene(
                light=leds()
                + '<emitter type="point" id="led_900"><transform name="to_world"><scale value="0"/></transform></emitter>'
            ),
            "emitter 'led_900' has a direction or position that is 0 or not finite; correct it.",
        ),
        (
            scene(light=leds() + '<emitter type="constant" id="led_900"/>'),
            "emitter 'led_900' shines from everywhere; write LEDs as directional or point, or as a shape with an area "
            "emitter.",
        ),
        (
            scene(light=leds(power=1e38)),
            "emitter 'led_000' has a power of 1e+38; give numbers from 1e-15 to 1e+15",
        ),
        (
            scene(sensor=camera().replace('x="1.4"', 'x="0"')),
            'to_world of the sensor "camera" is not finite or flat',
        ),
    ],
)
def test_what_ends_in_no_numbers_or_never_is_refused(tmp_path, monkeypatch, text, sentence):
    """A film beyond all memory and light paths without end came to no end; LEDs from nowhere gave no numbers."""
    monkeypatch.setattr("evsdr.errors.free_memory", lambda: 2.0**36)
    assert refused(tmp_path, text).startswith(f"{tmp_path / 'scene.xml'}: {sentence}")
