"""Scenes from a few figures: the signals are those of the scenes that came with the program."""

import shutil

import numpy as np
import pytest
from evsdr.scenes import make_rigs

from evsdr.errors import InputError
from evsdr.fitting.simulation import render
from evsdr.light.camera import view_of
from evsdr.light.scene import load_scene
from evsdr.rig.led_table import read_leds
from evsdr.rig.scene_writer import camera_of, scene_xml
from tests.conftest import REPOSITORY

SCENES = REPOSITORY / "scenes"
DISTANCE, WIDTH = f",{make_rigs.NEAR_DISTANCE:g}", f",{make_rigs.SOFT_WIDTH:g}"
RIGS = {
    "ring24.xml": ("", ""),
    "ring24_near.xml": (",distance", DISTANCE),
    "ring24_soft.xml": (",distance,size", DISTANCE + WIDTH),
}


@pytest.mark.parametrize("rig", [*list(RIGS)[:2], pytest.param("ring24_soft.xml", marks=pytest.mark.slow)])
def test_signals_are_those_of_the_scenes_by_hand(tmp_path, rig):
    for name in (rig, "camera.xml"):
        shutil.copy(SCENES / name, tmp_path)
    text = (SCENES / "sphere.xml").read_text().replace("ring24.xml", rig)
    text = text.replace('<include filename="bases_$bases.xml"/>', '<bsdf type="diffuse" id="surface"/>')
    (tmp_path / "by_hand.xml").write_text(text)
    comment, names, *lines = (SCENES / "ring24.csv").read_text().splitlines()
    name, cell = RIGS[rig]
    (tmp_path / "leds.csv").write_text("\n".join([names + name, *(line + cell for line in lines)]))
    camera = camera_of((8, 8), field_width=2.3)
    (tmp_path / "new.xml").write_text(scene_xml(camera, read_leds(tmp_path / "leds.csv"), sphere=1.0))
    by_hand, new = load_scene(tmp_path / "by_hand.xml", {"size": "8"}), load_scene(tmp_path / "new.xml")
    assert new.constant_light == by_hand.constant_light
    np.testing.assert_array_equal(new.leds.band, by_hand.leds.band)
    np.testing.assert_allclose(new.leds.band_spectrum, by_hand.leds.band_spectrum, rtol=1e-5)
    (signal, truth), (expected, true) = render(new, 1, 0), render(by_hand, 1, 0)
    assert expected.max() > 0.4
    np.testing.assert_allclose(signal, expected, atol=3e-6)
    np.testing.assert_allclose(truth.normal, true.normal, atol=1e-5)


def test_figures_of_the_camera(tmp_path):
    leds = read_leds(SCENES / "eventps.csv")
    assert len(leds) == 48
    camera = camera_of((64, 48), focal_mm=16, pixel_um=4.86, distance=300, center=(20, 30))
    (tmp_path / "new.xml").write_text(scene_xml(camera, leds, unit="mm"))
    ring = load_scene(tmp_path / "new.xml")
    assert (ring.width, ring.height, ring.leds.n_led, ring.leds.n_band) == (64, 48, 48, 1)
    assert ring.is_near and not ring.shape_is_known and ring.integrator.unit == "mm"
    view = view_of(ring)
    np.testing.assert_allclose(view.camera.center, (20, 30), atol=1e-3)
    np.testing.assert_allclose(view.camera.pixel_size, 4.86e-3 / 16, rtol=1e-4)
    seen = view.project(view.point_to_camera(np.array([[0.0, 0, 0], [10, 0, 0]])))
    np.testing.assert_allclose(seen[1, 0] - seen[0, 0], 10 / 300 * 16 / 4.86e-3, rtol=1e-4)
    origin, direction = view.rays(np.array([[0.0, 0], [64, 48]]))
    corners = (origin - view.origin[2] * direction / direction[:, 2:])[:, :2]
    box = ring.scene.bbox()  # the plane fills the film, however the camera is shifted
    assert box.min[0] < corners[0, 0] < corners[1, 0] < box.max[0]
    assert box.min[1] < corners[1, 1] < corners[0, 1] < box.max[1]


@pytest.mark.parametrize(
    "figures, sentence",
    [
        ({}, "tell the camera by --field-width, or by"),
        ({"focal_mm": 16.0}, "tell the camera by"),
        ({"focal_mm": 16.0, "distance": 3.0, "field_width": 2.0}, "tell the camera by"),
        ({"field_width": -1.0}, "--field-width is -1"),
        ({"focal_mm": 16.0, "distance": np.nan}, "--distance is nan"),
        ({"size": (0, 5), "field_width": 1.0}, "--size 0 5 is no size"),
        ({"field_width": 1.0, "center": (0, 0)}, "--center goes with --focal-mm"),
        ({"focal_mm": 16.0, "distance": 3.0, "center": (1e9, 0)}, "is far from the film"),
    ],
)
def test_no_camera(figures, sentence):
    with pytest.raises(InputError, match=sentence):
        camera_of(**{"size": (16, 16)} | figures)
