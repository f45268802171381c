"""LEDs that a fit found, written for the next scene."""

import json

import numpy as np
import pytest

from evsdr.commands import calibrate
from evsdr.light.camera import view_of
from evsdr.light.scene import load_scene
from evsdr.metrics import angular_error_deg
from evsdr.solve.shared.rig import across
from tests.support.analytic import ring_directions
from tests.support.small_scene import leds, scene

FACTOR = np.linspace(0.9, 1.1, 8)
TILT = np.random.default_rng(0).normal(0, 0.7, (8, 2))


def effects(powers=True, directions=True, factor=FACTOR) -> dict:
    """Write what a summary tells of the LEDs."""
    return {
        "LED powers": {
            "modelled": powers,
            "found": {
                "power_factor": factor.tolist(),
                "power_factor_sigma": np.full(len(factor), 0.01).tolist(),
            },
        },
        "LED directions": {
            "modelled": directions,
            "found": {"tilt_deg": TILT.tolist(), "tilt_sigma_deg": np.full_like(TILT, 0.1).tolist()},
        },
    }


@pytest.fixture
def files(tmp_path):
    """A scene, and a way to run the command on a summary."""
    (tmp_path / "scene.xml").write_text(scene())

    def run(summary, text=None) -> int:
        (tmp_path / "fit").mkdir(exist_ok=True)
        (tmp_path / "fit" / "summary.json").write_text(json.dumps(summary) if text is None else text)
        arguments = [
            "from-fit",
            str(tmp_path / "scene.xml"),
            str(tmp_path / "fit"),
            "--out",
            str(tmp_path / "out"),
        ]
        return calibrate.main(arguments)

    return tmp_path, run


@pytest.mark.parametrize("directions", [False, True])
def test_the_next_scene_has_what_was_found(files, capsys, directions):
    folder, run = files
    assert run({"effects": effects(directions=directions)}) == 0
    assert {f.name for f in (folder / "out").iterdir()} == {"rig.xml", "calibration.json", "residuals.png"}
    (folder / "next.xml").write_text(scene(light='<include filename="out/rig.xml"/>'))
    told, found = load_scene(folder / "scene.xml"), load_scene(folder / "next.xml")
    np.testing.assert_allclose(found.leds.power, FACTOR * told.leds.power, rtol=1e-5)
    light, _ = found.integrator.illumination(found.scene, found.sensor, 1, 0, False)
    here = np.array([np.array(d).ravel() for d in light.direction])
    d = ring_directions(8)
    expected = np.array([v + a @ across(v) for v, a in zip(d, np.radians(TILT) * directions)])
    assert angular_error_deg(here @ view_of(found).frame.T, expected @ view_of(found).frame.T).max() < 1e-3
    said = json.loads((folder / "out" / "calibration.json").read_text())
    assert said["taken"] == ["powers", "directions"][: 1 + directions]
    assert said["leds"][7]["sigma"] == pytest.approx(0.01 * said["leds"][7]["scene_file"], rel=1e-4)
    assert "+10.00%" in capsys.readouterr().out


@pytest.mark.parametrize(
    "summary, says",
    [
        ({"effects": effects(False, False)}, "as told, so there is nothing to take over"),
        ({"effects": effects(factor=FACTOR[:5])}, "it tells of 5 LEDs but the scene has 8"),
        ({"effects": effects(factor=FACTOR * np.nan)}, "power_factor is not finite"),
        ({"effects": effects(factor=FACTOR - 1)}, "power_factor is not above 0"),
        ({"effects": {}}, "does not tell of LED powers"),
        (
            {"effects": {"LED powers": {"modelled": True, "found": {"power_factor": "a"}}}},
            "does not tell of LED powers",
        ),
        ([], "does not tell of LED powers"),
    ],
)
def test_what_can_not_be_taken_over_is_refused(files, capsys, summary, says):
    folder, run = files
    assert run(summary) == 2
    error = capsys.readouterr().err
    assert says in error and error.count("\n") == 1
    assert not (folder / "out").exists()


def test_near_leds_keep_their_places(files):
    folder, run = files
    (folder / "scene.xml").write_text(scene(light=leds(distance=4.0)))
    assert run({"effects": effects(directions=False)}) == 0
    text = (folder / "out" / "rig.xml").read_text()
    assert text.count('name="position"') == 8 and "direction" not in text
