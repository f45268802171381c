"""A budget of time: the best preset that it allows, an end of the solver in time, and what the summary says."""

import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest

import evsdr
from evsdr.errors import InputError
from evsdr.fitting import budget
from evsdr.fitting.budget import AFTER, COST, MOST, UNKNOWN_SHAPE, budget_of, plan, slowness, task_seconds
from evsdr.fitting.settings import Settings, check_settings
from evsdr.progress import silent
from evsdr.records import Events, Recording, Schedule, Sensor
from tests.conftest import REPOSITORY


def planned(seconds, slow=1.0, n_pixel=10_000, n_event=1_000_000, began=None):
    began = time.perf_counter() if began is None else began
    return plan(Settings(time_budget=seconds), n_pixel, n_event, began, slow)


def test_the_best_preset_that_fits_is_taken():
    expected = {name: cost.seconds(10_000, 1_000_000) for name, cost in COST.items()}
    assert sorted(expected.values(), reverse=True) == list(expected.values())
    for name, seconds in expected.items():
        enough = 1.02 * seconds / MOST
        found = planned(enough)
        assert found.settings.preset == name and found.expected_s == pytest.approx(seconds)
        assert planned(enough * 10, 10.0).settings.preset == name
    assert planned(0.01).settings.preset == "fast"


def test_unknown_shapes_take_longer():
    """But where nothing hides LEDs, as asked for."""
    given, now = (10_000, 1_000_000), time.perf_counter()
    settings = Settings(time_budget=1000.0), replace(Settings(time_budget=1000.0), shadows="off")
    known, unknown, off = (
        plan(s, *given, now, 1.0, k).expected_s
        for s, k in ((settings[0], True), (settings[0], False), (settings[1], False))
    )
    assert unknown == pytest.approx(UNKNOWN_SHAPE * known) and off == known


def test_pixels_that_fire_count(monkeypatch):
    monkeypatch.setattr(budget, "slowness", lambda: 1.0)
    x, y, p = np.array([[1, 1, 3], [0, 0, 2], [0, 1, 1]])
    events = Events(x.astype(np.uint16), y.astype(np.uint16), p.astype(np.int8), np.arange(3))
    schedule = Schedule(np.arange(2, dtype=np.int32), 100.0, 1.0)
    recording = Recording(events, Sensor(4, 3, 0.2, 0.2, 0.0), schedule, np.zeros(0), "a.h5")
    found = budget_of(Settings(time_budget=100.0), recording, time.perf_counter())
    assert found.expected_s == pytest.approx(COST["accurate"].seconds(2, 3), rel=1e-12)
    assert budget_of(Settings(), recording, time.perf_counter()) is None


def test_the_solver_ends_before_the_budget_does():
    now = time.perf_counter()
    after = AFTER.seconds(10_000, 1_000_000)
    assert planned(100.0, began=now).end - now == pytest.approx(100 - after, abs=1e-6)
    assert planned(0.1, began=now).end - now == pytest.approx(0.05, abs=1e-6)
    over, going = planned(1e-9), planned(100.0)
    assert over.watch(silent)("solve", 0.0) is True
    assert going.watch(silent)("solve", 0.0) is False
    assert going.watch(lambda *_: True)("solve", 0.0) is True


def test_this_machine_is_measured():
    assert 0 < task_seconds() < 60 and 0 < slowness() < 1000
    code = "import time; time.sleep(0.3); from evsdr.fitting.budget import seconds_so_far; print(seconds_so_far())"
    start = time.perf_counter()
    told = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=REPOSITORY
    )
    assert 0.25 < float(told.stdout) < time.perf_counter() - start + 0.05


def test_a_budget_is_above_zero():
    with pytest.raises(InputError, match="time_budget is 0; give seconds above 0"):
        check_settings(Settings(time_budget=0.0))


def test_what_is_found_by_its_end_counts(place):
    given = evsdr.load_scene(place / "scene.xml"), evsdr.read_recording(place / "events.h5")
    with pytest.warns(evsdr.InputWarning, match="this fit was stopped early"):
        found = evsdr.fit(*given, Settings(time_budget=1e-3))
    assert found.summary["stopped"] and found.summary["stopped_by"] == "time budget"
    assert found.summary["time_budget"]["preset"] == found.summary["preset"] == "fast"
    truth = np.load(place / "truth.npz")
    truth = evsdr.Truth(truth["normal"], truth["reflectance"], truth["mask"])
    assert evsdr.score(found.maps, truth)["mae_deg"] < 10
