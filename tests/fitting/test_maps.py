"""What a fit says of the bands of a ring."""

import json

import numpy as np
import pytest

import evsdr
from evsdr.commands import fit, simulate
from evsdr.fitting.maps import lit_bands, rim
from tests.support.small_scene import DIFFUSE, camera, leds, scene


def test_bands_that_are_lit():
    band = [0, 1, 2, 0, 1, 2]
    np.testing.assert_array_equal(lit_bands([0, 3, -1], band), [True, False, False])
    np.testing.assert_array_equal(lit_bands([5, 4, 0, 6], band), [True, True, True])


def test_a_band_that_is_never_lit_is_not_known(tmp_path):
    """Of twelve LEDs in two bands only those of the first shine."""
    text = scene(light=leds(12), sensor=camera(width=24, height=24))
    (tmp_path / "scene.xml").write_text(text)
    argv = [str(tmp_path / "scene.xml"), "--out", str(tmp_path)]
    assert simulate.main([*argv, "--ideal", "--order", *"-1 0 2 4 6 8 10".split()]) == 0
    assert fit.main([argv[0], str(tmp_path / "events.h5"), "--out", str(tmp_path / "fit")]) == 0
    with np.load(tmp_path / "fit" / "maps.npz") as maps:
        sigma = maps["reflectance_sigma"][maps["mask"]]
    assert (sigma[:, 1] == 1).all() and np.median(sigma[:, 0]) < 0.1
    note = json.loads((tmp_path / "fit" / "summary.json").read_text())["model"]["bands"]
    assert note.startswith("1 of 2: order lights no LED of 620 nm")


def test_a_plane_inside_the_ring_knows_its_scale_by_dark_slots(tmp_path):
    """Lit by all LEDs, each pixel alone can't tell how bright it is; with dark slots it can."""
    plane = f'<shape type="rectangle" id="object"><transform name="to_world"><scale value="5"/></transform>{DIFFUSE}</shape>'
    (tmp_path / "scene.xml").write_text(
        scene(shape=plane, light=leds(12), sensor=camera(width=12, height=12))
    )
    ring = evsdr.load_scene(tmp_path / "scene.xml")
    dark = np.insert(np.arange(12), [3, 6, 9, 12], -1)
    settings = evsdr.Settings(preset="fast", shared=(), priors=())

    def known(order):
        schedule = evsdr.Schedule(order.astype(np.int32), 2e4, 1.0)
        recording, _ = evsdr.simulate(ring, schedule=schedule, seed=1)
        found = evsdr.fit(ring, recording, settings)
        assert not (found.maps.mask_reflectance & ~found.maps.mask).any()
        return np.mean(found.maps.mask_reflectance), found.verdict

    with pytest.warns(evsdr.InputWarning, match="put a dark slot"):
        share, verdict = known(np.arange(12))
    assert share < 0.3 and str(verdict).startswith("doubtful: ") and "can't tell their scale" in str(verdict)
    assert known(dark)[0] > 0.9


def test_rim_of_an_object():
    """What touches pixels outside, corners included; an object that fills the film has none."""
    mask = np.zeros((6, 6), bool)
    mask[1:6, 1:6] = True
    image = np.zeros((6, 6), bool)
    image[mask] = rim(mask)
    expected = mask.copy()
    expected[2:, 2:] = False
    np.testing.assert_array_equal(image, expected)
    assert not rim(np.ones((4, 5), bool)).any()
