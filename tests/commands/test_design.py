import json

import numpy as np
import png
import pytest

from evsdr.commands import design
from tests.support.small_scene import DIFFUSE, HEIGHT, SPHERE, WIDTH, camera, leds, scene


@pytest.fixture
def place(tmp_path, monkeypatch):
    """Give a folder with a scene.xml, from which the command runs."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.xml").write_text(scene())
    return tmp_path


def run(*argv):
    return design.main(["scene.xml", *map(str, argv)])


def results(folder):
    return json.loads((folder / "design.json").read_text(), parse_constant=pytest.fail)  # NaN and infinity


def refused(capsys, place, *argv):
    """Run on bad input, check that nothing but one sentence comes of it, and give the sentence."""
    before = sorted(place.rglob("*"))
    assert run(*argv) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert sorted(place.rglob("*")) == before
    return err


@pytest.mark.parametrize("distance", [None, 5.0])
def test_the_leds_are_listed_as_the_object_sees_them(place, distance):
    (place / "scene.xml").write_text(scene(light=leds(distance=distance, power=2.0)))
    assert run() == 0
    listed = results(place / "out" / "design_scene")["leds"]
    assert [led["id"] for led in listed] == [f"led_{j:03d}" for j in range(8)]
    assert [led["band"] for led in listed] == [0, 1] * 4
    np.testing.assert_allclose([led["centroid_nm"] for led in listed], [450, 620] * 4, atol=1)
    np.testing.assert_allclose([led["polar_deg"] for led in listed], 45, atol=1e-3)
    np.testing.assert_allclose([led["azimuth_deg"] for led in listed], 45.0 * np.arange(8), atol=1e-3)
    np.testing.assert_allclose([led["power"] for led in listed], 2, rtol=1e-3)
    assert all(led["inside_safe_range"] for led in listed)


def test_directions_are_those_of_the_camera_and_of_the_objects_centre(place):
    """The camera looks along x and a near LED stands above an object off the origin."""
    sensor = camera().replace('origin="0, 0, 4" target="0, 0, 0"', 'origin="6, 3, 0" target="2, 3, 0"')
    moved = SPHERE.replace(DIFFUSE, f'<point name="center" x="2" y="3" z="0"/>{DIFFUSE}')
    c = 5 / 2**0.5
    above = leds(distance=5.0).replace(f'x="{c}" y="0.0" z="{c}"', 'x="6" y="7" z="0"')
    (place / "scene.xml").write_text(scene(sensor=sensor, light=above, shape=moved))
    assert run("--out", "there") == 0
    first = results(place / "there")["leds"][0]
    assert (first["polar_deg"], first["azimuth_deg"]) == pytest.approx((45, 90), abs=1e-3)


def test_what_it_prints_and_draws(place, capsys):
    assert run("--order", 0, 1, 2, 4, 5, 6, "--out", "there") == 0
    out, _ = capsys.readouterr()
    for text in ("led_000", "27.51 to 60.51", "gloss", "Band 1 is lit by LEDs in one plane", "bound.png"):
        assert text in out
    width, height, rows, _ = png.Reader(bytes=(place / "there" / "bound.png").read_bytes()).asRGBA8()
    picture = np.array(list(rows)).reshape(height, width, 4)
    assert width > 2 * height
    for part in np.array_split(picture, 2, axis=1):  # a map and its colour bar in each
        assert len(np.unique(part[np.ptp(part[..., :3], axis=-1) > 50], axis=0)) > 50  # no greys
    assert sorted(p.name for p in (place / "there").iterdir()) == ["bound.png", "design.json"]


def test_the_bound_is_summed_up_over_the_object(place):
    """A sphere fills pi / (4 x 1.4^2 x 3/4) of the film; noise and rounds do to sigma what they should."""
    assert run("--out", "one", "--ideal", "--event-noise", 0.05, "--rounds", 3) == 0
    assert run("--out", "noisy", "--ideal", "--event-noise", 0.15, "--rounds", 3) == 0
    one, noisy = (results(place / name)["bound"] for name in ("one", "noisy"))
    assert 0.6 < one["pixels"] / (WIDTH * HEIGHT * np.pi / (4 * 1.4**2 * 0.75)) < 1
    assert one["pairs_per_pixel"] > 5
    assert 0 < one["reflectance_median"] < one["reflectance_mean"] < 1
    assert noisy["normal_deg_median"] == pytest.approx(3 * one["normal_deg_median"], rel=0.15)
    assert one["normal_deg_median"] < one["normal_deg_rms"]


def test_what_pixels_share_is_unknown_to_a_tolerance(place, capsys):
    assert run("--out", "told") == run("--out", "untold", "--leds-told-to", 3) == 0
    told, untold = (results(place / name) for name in ("told", "untold"))
    assert told["bound"] == untold["bound"]
    medians = [r[key]["normal_deg_median"] for r, key in ((told, "bound"), (told, "bound_shared_unknown"))]
    assert medians[0] < medians[1] < untold["bound_shared_unknown"]["normal_deg_median"]
    assert told["shared_sigma"]["directions_deg"] is None
    assert 0.5 < untold["shared_sigma"]["directions_deg"] < 3
    assert "LEDs and thresholds unknown" in capsys.readouterr().out


def test_it_tells_that_constant_light_and_bands_are_missing(place):
    assert run("--out", "there", "-D", "constant_light=0", "--order", 1, 3, 5, 7) == 0
    found = results(place / "there")
    assert [p[:22] for p in found["problems"]] == ["Band 0 is never lit: n", "There is no constant l"]
    assert found["bound"]["share_reflectance_known"] == 0
    assert found["bound"]["reflectance_mean"] is None
    assert found["bound"]["share_normal_known"] > 0.5
    assert found["constant_light"] == 0
    assert found["normals_without_clean_band"] == 0  # of the bands that are lit


def test_gloss_that_no_polar_angle_avoids(place, capsys):
    assert run("--out", "there", "--shininess", 2) == 0
    found = results(place / "there")
    assert found["safe_polar_deg"] is None
    assert not any(led["inside_safe_range"] for led in found["leds"])
    assert found["normals_without_clean_band"] > 0
    assert "none" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("argv", "named"),
    [
        (["--ideal", "--noise", 0], "--event-noise"),
        (["--noise", "nan"], "event_noise"),
        (["--rounds", 0], "--rounds"),
        (["--slot-us", 0], "--slot-us"),
        (["--crossfade", 1.5], "--crossfade"),
        (["--leds-told-to", -1], "--leds-told-to"),
        (["--shininess", 0], "--shininess"),
        (["--gloss-threshold", 0], "--gloss-threshold"),
        (["--threshold-on", 0], "contrast_threshold_on"),
        (["--refractory-us", -1], "refractory_us"),
        (["--order", 0, 8], "--order"),
        (["--order", -1, -1], "--order"),
        (["-D", "constant_light"], "-D constant_light"),
        (["-D", "constant_light=10000"], "scene.xml"),
        (["--out", "scene.xml"], "--out"),
    ],
)
def test_bad_options_are_refused(place, capsys, argv, named):
    assert named in refused(capsys, place, *argv)


def test_an_object_out_of_sight_is_refused(place, capsys):
    far = SPHERE.replace(DIFFUSE, f'<point name="center" x="20" y="0" z="0"/>{DIFFUSE}')
    (place / "scene.xml").write_text(scene(shape=far))
    assert "does not see the shape object" in refused(capsys, place)
