"""The entrance from Python: the same results as the command, on files and on arrays."""

import subprocess
import sys
import warnings
from dataclasses import replace

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

import evsdr
from evsdr.commands import fit as command
from evsdr.fitting.entrance import collected_warnings
from tests.support.small_scene import HEIGHT, WIDTH

FAST = evsdr.Settings(preset="fast", shared=())


@pytest.fixture
def given(place):
    return evsdr.load_scene(place / "scene.xml"), evsdr.read_recording(place / "events.h5")


def test_every_name_is_there():
    assert set(evsdr.__all__) <= set(dir(evsdr))
    for name in evsdr.__all__:
        assert getattr(evsdr, name).__name__ == name
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        evsdr.nothing


@pytest.mark.parametrize(
    "name", ["Recording", "read_recording", "load_scene", "Settings", "fit", "Fit", "score"]
)
def test_names_load_no_mitsuba(name):
    """It must know its libLLVM before it is imported."""
    code = f"import sys, evsdr; evsdr.{name}; print(*{{'mitsuba', 'drjit', 'numba', 'scipy'}} & set(sys.modules))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == ""


def test_saved_results_are_those_of_the_command(place, given, tmp_path, capsys):
    assert (
        command.main(
            [str(place / "scene.xml"), str(place / "events.h5"), "--preset", "fast", "--shared", "none"]
        )
        == 0
    )
    evsdr.fit(*given, FAST).save(tmp_path / "api")
    assert {p.name for p in (tmp_path / "api").iterdir()} == {p.name for p in (place / "events").iterdir()}
    ours, theirs = (np.load(folder / "maps.npz") for folder in (tmp_path / "api", place / "events"))
    for name in theirs.files:
        np.testing.assert_array_equal(ours[name], theirs[name])


def test_a_fit_carries_what_its_page_shows(given, tmp_path):
    found = evsdr.fit(*given, FAST)
    n = found.summary["numbers"]["pixels_solved"]
    assert found.signals.modelled.shape == (n, 8) and found.depth.mask.sum() == n and found.truth is None
    found.save(tmp_path, report=False)
    assert not (tmp_path / "report.html").exists() and (tmp_path / "maps.npz").exists()
    found.save(tmp_path)
    assert "from Python" in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_a_fit_from_arrays_names_no_file(given):
    ring, recording = given
    bare = replace(recording, source="the recording", sensor=replace(recording.sensor, width=WIDTH + 1))
    with pytest.raises(evsdr.InputError, match=f"but the events of the recording are {WIDTH + 1} x {HEIGHT}"):
        evsdr.fit(ring, bare, FAST)


def test_a_scene_may_be_a_dictionary(given):
    _, recording = given
    far = {"type": "directional", "irradiance": {"type": "rgb", "value": 1.0}}
    with pytest.raises(evsdr.InputError, match="^the scene: "):
        evsdr.load_scene({"type": "scene", "led_0": far})
    with pytest.raises(evsdr.InputError, match="no parameter size to set"):
        evsdr.load_scene({"type": "scene"}, size=8)


def test_progress_and_seconds(given):
    told = []
    found = evsdr.fit(*given, FAST, progress=lambda stage, share: told.append((stage, share)))
    stages = found.summary["seconds"]
    assert [stage for stage, share in told if share == 0] == list(stages)
    assert all(0 <= share <= 1 for _, share in told) and any(", " in stage for stage, _ in told)


@pytest.mark.filterwarnings(
    "ignore:.*reflectance falls with the tilt:evsdr.errors.InputWarning"
)  # in so few pixels
@pytest.mark.parametrize("when", ["solve, descent", "neighbours, decide on LED powers"])
def test_a_fit_that_is_told_to_end_keeps_the_best_so_far(given, tmp_path, when):
    came = []

    def progress(stage, share):
        came.append(stage == when or any(came))
        return came[-1]

    with pytest.warns(evsdr.InputWarning, match="this fit was stopped early"):
        found = evsdr.fit(*given, evsdr.Settings(), progress=progress)
    whole = evsdr.fit(*given, evsdr.Settings())
    assert found.summary["stopped"] and not whole.summary["stopped"]
    assert "stopped early" in found.verdict and found.verdict.startswith("doubtful")
    assert found.summary["numbers"]["steps"] < 0.7 * whole.summary["numbers"]["steps"]
    assert np.count_nonzero(found.maps.mask) > 0.9 * np.count_nonzero(whole.maps.mask)
    assert "LED powers" not in found.decisions  # what is decided but not fitted does not count
    found.save(tmp_path)
    assert evsdr.read_results(tmp_path)[1]["stopped"]


def test_a_mask_of_another_size_is_refused(given):
    with pytest.raises(evsdr.InputError, match="^the mask has shape"):
        evsdr.fit(*given, FAST, mask=np.ones((WIDTH, HEIGHT)))
    with pytest.raises(evsdr.InputError, match="^the mask: the mask has no pixel"):
        evsdr.fit(*given, FAST, mask=np.zeros((HEIGHT, WIDTH)))


def test_bad_settings_are_refused_before_the_work(given):
    with pytest.raises(evsdr.InputError, match="shadows is 'dark'"):
        evsdr.fit(*given, evsdr.Settings(shadows="dark"))


def test_each_warning_is_given_once_and_listed():
    with warnings.catch_warnings(record=True) as caught, pytest.raises(ValueError, match="stop"):
        warnings.simplefilter("always")
        with collected_warnings() as messages:
            for text in ("a", "b", "a"):
                warnings.warn(evsdr.InputWarning(text))
            raise ValueError("stop")
    assert messages == ["a", "b"] == [str(w.message) for w in caught]


def test_matrices_stay_in_one_thread_while_a_fit_runs(given):
    """And have those that the user gave them afterwards."""
    during = []

    def note(stage, share):
        during.extend(blas_threads())

    with threadpool_limits(2, user_api="blas"):
        evsdr.fit(*given, FAST, progress=note)
        assert set(during[-2:]) == {1} and set(blas_threads()) == {2}


def blas_threads() -> list[int]:
    """Give the threads of each BLAS that is loaded."""
    return [lib["num_threads"] for lib in threadpool_info() if lib["user_api"] == "blas"]
