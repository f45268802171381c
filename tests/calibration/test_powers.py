"""LED powers and C_w as the command finds and writes them."""

import json

import numpy as np
import pytest

from evsdr.commands import calibrate
from evsdr.files.events_h5 import write_recording
from evsdr.light.scene import load_scene
from tests.support.analytic import ring_directions
from tests.support.balls import LIGHT
from tests.support.small_scene import leds, scene
from tests.support.white_patches import TILTS, record_patch


@pytest.fixture(scope="module")
def patches(tmp_path_factory):
    """A scene with eight LEDs of equal power, and recordings of tilts under LEDs that are not."""
    folder = tmp_path_factory.mktemp("patch")
    (folder / "scene.xml").write_text(scene(light=leds(8)))
    power = np.linspace(0.8, 1.2, 8)
    for k, normal in enumerate(TILTS):
        order = [i for j in range(8) for i in (j, -1)]
        recording = record_patch(ring_directions(8), power, normal, order, k, shape=(12, 16))
        write_recording(folder / f"tilt_{k}.h5", recording)
    few = record_patch(ring_directions(8), power, TILTS[1], [0, -1, 1, -1], 0, shape=(12, 16))
    write_recording(folder / "few.h5", few)
    return folder, power


def tilt_arguments(folder) -> list[str]:
    return [f"{folder}/tilt_{k}.h5:{','.join(f'{c:.6f}' for c in n)}" for k, n in enumerate(TILTS)]


def test_powers_command_writes_a_rig_that_sets_c_w(patches, tmp_path):
    folder, power = patches
    out = tmp_path / "out"
    arguments = ["powers", str(folder / "scene.xml"), *tilt_arguments(folder), "--out", str(out)]
    assert calibrate.main([*arguments, "--tilt-sigma-deg", "0.1"]) == 0
    assert {f.name for f in out.iterdir()} == {"rig.xml", "calibration.json", "residuals.png"}
    said = json.loads((out / "calibration.json").read_text())
    text = scene(light="").replace("<default", '<include filename="out/rig.xml"/><default', 1)
    (tmp_path / "scene.xml").write_text(text)
    ring = load_scene(tmp_path / "scene.xml")
    assert ring.constant_light == pytest.approx(LIGHT, rel=0.02)
    assert ring.constant_light == pytest.approx(said["constant_light"]["value"], rel=1e-5)
    np.testing.assert_allclose(ring.leds.power, power, rtol=0.01)
    assert 0 < said["constant_light"]["sigma"] < 0.02 * LIGHT
    assert all(0 < led["sigma"] < 0.01 for led in said["leds"])


def test_a_tilt_that_was_told_wrong_is_named(patches, tmp_path, capsys):
    folder, _ = patches
    wrong = tilt_arguments(folder)
    wrong[2] = f"{folder}/tilt_2.h5:" + ",".join(f"{c:.6f}" for c in TILTS[2] + [np.radians(2.0), 0, 0])
    arguments = ["powers", str(folder / "scene.xml"), *wrong, "--out", str(tmp_path / "out")]
    assert calibrate.main([*arguments, "--tilt-sigma-deg", "0.3"]) == 0
    (named,) = [line for line in capsys.readouterr().err.splitlines() if "turn this tilt" in line]
    assert "tilt_2.h5" in named and "more than two sigma of 0.3" in named


@pytest.mark.parametrize(
    "patch, says",
    [
        ("{}/tilt_0.h5", "write a patch as events.h5:nx,ny,nz"),
        ("{}/tilt_0.h5:0,0,-1", "nz above 0"),
        ("{}/none.h5:0,0,1", "no such file"),
        ("{}/few.h5:0,0,1", "lights 2 LEDs but"),
        ("{}/tilt_0.h5:0,0,1:{}/mask.npy", "no pixel sees the patch"),
    ],
)
def test_patches_that_can_not_be_used_are_refused(patches, tmp_path, capsys, patch, says):
    folder, _ = patches
    np.save(folder / "mask.npy", np.zeros((12, 16), np.uint8))
    arguments = ["powers", str(folder / "scene.xml"), patch.replace("{}", str(folder))]
    assert calibrate.main([*arguments, "--out", str(tmp_path / "out")]) == 2
    assert says in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
