"""The experiment on cast shadows: what each way is told, and how its errors are counted."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import evsdr
from evsdr import EventPixel, Maps, Truth
from evsdr.effects import world
from evsdr.solve.visibility import Seen
from experiments.cast_shadow import __main__ as command
from experiments.cast_shadow import compute
from experiments.cast_shadow.draw import draw

SIZE = 16


def made_up(way="latent", angle_deg=(0.5, 2, 4, 9), hidden=(0, 3, 0, 1), known=(1, 1, 1, 0), found=None):
    """Make a result of four pixels, whose sigma is 1 degree."""
    shape = 2, 2
    angle, hidden, known = (np.reshape(a, shape) for a in (np.radians(angle_deg), hidden, known))
    normal = np.stack([np.sin(angle), np.zeros(shape), np.cos(angle)], axis=-1)
    frontal, grey = np.broadcast_to([0.0, 0.0, 1.0], (*shape, 3)), np.full((*shape, 2), 0.5)
    maps = Maps(normal, grey + 0.1, known == 1, np.ones(shape), grey, np.array([450.0, 600.0]))
    truth = Truth(frontal, grey, np.ones(shape, bool))
    return compute.Result(way, maps, truth, hidden, found, 1.0)


def case(name: str, folder: Path) -> compute.Case:
    return next(c for c in compute.cases(folder) if c.name == name)


def test_errors_are_those_of_known_pixels_inside_and_outside():
    r = made_up()
    np.testing.assert_array_equal(r.inside, [[False, True], [False, False]])
    np.testing.assert_array_equal(r.outside, [[True, False], [True, False]])
    assert (r.within(1), r.within(3)) == pytest.approx((1 / 3, 2 / 3))
    cells = dict(zip(list(command.COLUMNS)[1:], command.cells(r, np.array([[True, True], [False, False]]))))
    assert (cells["in shadow"], cells["known"], cells["1 sigma"]) == ("50%", "75%", "33%")
    assert (cells["angle: all"], cells["inside"], cells["outside"]) == ("2.17", "2.00", "2.25")
    assert cells["common"] == "1.25"
    assert cells["RMSE"] == "0.1000"


def test_nothing_known_is_no_number():
    assert command.cells(made_up(hidden=(0, 0, 0, 0)), np.ones((2, 2), bool))[3] == "nan"


def test_leds_behind_the_horizon_are_not_hidden():
    direction = np.array([[[0, 0, 1.0]] * 2, [[1.0, 0, 0]] * 2])  # one in front, one to the right
    normal = np.array([[[0, 0, 1.0], [np.sqrt(0.5), 0, np.sqrt(0.5)]]])
    visible = np.array([[0.2, 0.8], [0.0, 0.0]])
    np.testing.assert_array_equal(compute.n_hidden(visible, direction, normal), [[1, 1]])


def test_what_was_found_is_counted_at_its_place():
    truth = Truth(np.broadcast_to([0.0, 0.0, 1.0], (2, 2, 3)), None, np.array([[False, True], [True, False]]))
    shadow = compute.Shadow(np.broadcast_to([0.0, 0.0, 1.0], (3, 4, 3)), None)
    seen = Seen(np.array([[1, 0], [1, 0], [1, 0.4]]), None, None)
    fit = SimpleNamespace(maps=truth, decisions={"cast shadows": SimpleNamespace(answer=seen, modelled=True)})
    np.testing.assert_array_equal(compute.found_hidden(fit, shadow, truth), [[0, 0], [3, 0]])
    fit.decisions["cast shadows"].modelled = False
    assert compute.found_hidden(fit, shadow, truth) is None


def test_a_moved_pole_casts_its_shadow_elsewhere(tmp_path):
    moved = case("a moved pole", tmp_path)
    assert moved.told == moved.known != moved.scene
    _, truth = evsdr.simulate(evsdr.load_scene(moved.scene, size=SIZE), rounds=1)
    here, there = (compute.true_shadow(file, truth, SIZE).hidden for file in (moved.scene, moved.told))
    assert 0.05 < np.mean(here[truth.mask] > 0) < 0.5
    assert 0.1 < np.sum(here != there) / np.sum(here > 0) < 1.5


@pytest.mark.parametrize("found", [False, True])
def test_each_way_is_told_what_it_may_know(tmp_path, monkeypatch, found):
    """The shape only for `scene`; thresholds as one value; the pixels of the object but for one. Nothing is fitted twice."""
    told, traced = [], world.find_visibility

    def fit(scene, recording, settings, mask):
        untraced = world.find_visibility is not traced
        told.append((settings, untraced, scene.shape_is_known, recording.sensor, mask))
        seen = Seen(np.ones((24, np.count_nonzero(truth.mask))), None, None)
        decision = SimpleNamespace(modelled=found, answer=seen)
        return SimpleNamespace(maps=truth, decisions={"cast shadows": decision}, summary={"seconds": {}})

    relief = case("relief", tmp_path)
    recording, truth = evsdr.simulate(evsdr.load_scene(relief.scene, size=SIZE), rounds=1)
    monkeypatch.setattr(evsdr, "simulate", lambda scene: (recording, truth))
    monkeypatch.setattr(evsdr, "fit", fit)
    assert [r.way for r in compute.run(relief, SIZE)] == list(compute.WAYS)
    ways = [way for way in compute.WAYS if way != "latent" or not found]
    assert [settings for settings, *_ in told] == [compute.WAYS[way] for way in ways]
    assert world.find_visibility is traced
    for way, (_, untraced, known, sensor, mask) in zip(ways, told):
        assert known == (way == "scene") and untraced == (way == "events")
        assert mask is (None if way == "unmasked" else truth.mask)
        assert sensor.contrast_threshold_on == pytest.approx(EventPixel().contrast_threshold_on, rel=0.02)
        assert isinstance(sensor.contrast_threshold_off, float)
    assert [r.way for r in compute.run(relief, SIZE, ["latent", "scene"])] == ["latent", "scene"]


def test_the_picture(tmp_path):
    results = [made_up("off"), made_up("latent", found=np.array([[0, 3], [0, 0]]))]
    draw(results, tmp_path / "picture.png")
    assert (tmp_path / "picture.png").stat().st_size > 5_000
