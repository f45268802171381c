"""Scene files as text: flat, and with LEDs moved and scaled."""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from evsdr.calibration.scene_text import find_leds, flatten, include_text, place_led, scale_led
from evsdr.errors import InputError
from evsdr.light.ground_truth import surface_maps
from evsdr.light.scene import load_scene
from tests.support.small_scene import scene

SCENES = Path(__file__).resolve().parents[2] / "scenes"


def test_flat_scene_is_the_same_scene(tmp_path):
    """Includes, defaults and file names replaced; LEDs complete in themselves."""
    root = flatten(SCENES / "near_ring.xml", {"size": "16"})
    assert not root.findall("include") and "$" not in ET.tostring(root, encoding="unicode")
    (tmp_path / "flat.xml").write_text(ET.tostring(root, encoding="unicode"))
    flat, ring = load_scene(tmp_path / "flat.xml"), load_scene(SCENES / "near_ring.xml", {"size": "16"})
    np.testing.assert_allclose(surface_maps(flat, 1).reflectance, surface_maps(ring, 1).reflectance)
    found = find_leds(root)
    moved = [place_led(scale_led(led, 1.5), None, np.array([j, 1.0, 4.0])) for j, led in enumerate(found)]
    (tmp_path / "rig.xml").write_text(include_text("moved", moved, {"constant_light": 0.125}))
    (tmp_path / "scene.xml").write_text(
        scene(light="").replace("<default", '<include filename="rig.xml"/><default', 1)
    )
    loaded = load_scene(tmp_path / "scene.xml")
    np.testing.assert_allclose(loaded.leds.power, 1.5 * ring.leds.power, rtol=1e-5)
    np.testing.assert_array_equal(loaded.leds.band, ring.leds.band)
    assert loaded.constant_light == 0.125


@pytest.mark.parametrize(
    "spectrum, factor_on",
    [
        ('<spectrum name="irradiance" value="430:0, 450:0.5, 470:0"/>', "430:0, 450:1, 470:0"),
        ('<spectrum name="irradiance" value="0.25"/>', "0.5"),
        ('<rgb name="irradiance" value="0.5 1e-1 0"/>', "1 0.2 0"),
    ],
)
def test_spectra_are_scaled_as_text(spectrum, factor_on):
    led = ET.fromstring(f'<emitter type="directional" id="led_0">{spectrum}</emitter>')
    assert scale_led(led, 2.0)[0].get("value") == factor_on
    assert scale_led(led, 1.0)[0].get("value") != factor_on


def test_leds_that_can_not_be_moved_or_scaled_are_refused(tmp_path):
    shape = ET.fromstring('<shape type="rectangle" id="led_0"><emitter type="area"/></shape>')
    with pytest.raises(InputError, match="a shape that shines"):
        place_led(shape, np.array([0, 0, 1.0]), None)
    with pytest.raises(InputError, match="no spectrum to scale"):
        scale_led(shape, 2.0)
    file = '<emitter type="point" id="led_0"><spectrum name="intensity" type="d65"/></emitter>'
    with pytest.raises(InputError, match="type d65 can't be scaled"):
        scale_led(ET.fromstring(file), 2.0)
    (tmp_path / "bad.xml").write_text("<scene>")
    with pytest.raises(InputError, match="not a readable scene file"):
        flatten(tmp_path / "bad.xml", {})
