"""The solvers with their settings: the published one stays as published, ours goes on from where it was."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from evsdr.fitting import decoder
from evsdr.fitting.decoder import Decoder, choose_effort
from evsdr.fitting.presets import PRESETS
from evsdr.fitting.settings import Settings
from evsdr.solve.solution import STEPS_USED_UP
from tests.support.sphere import C_W, sphere_problem

SIZE = 16
RING = SimpleNamespace(
    constant_light=C_W, leds=SimpleNamespace(band_wavelength_nm=np.arange(8.0)), height=SIZE, width=SIZE
)
FRONTAL = np.broadcast_to(np.array([0, 0, 1], np.float32), (SIZE, SIZE, 3))


@pytest.fixture(scope="module")
def problem():
    return sphere_problem(SIZE, event_noise=0.1)[0]


@pytest.mark.parametrize(("shadows", "robust"), [("auto", None), ("downweight", 3.0)])
def test_the_published_decoder_gives_its_own_result(problem, shadows, robust, monkeypatch, rng):
    """To the bit, wherever it looks; weights that shadows ask for act in its own loss."""
    normal = rng.normal(size=(problem.n_pixel, 3)).astype(np.float32)
    normal[:, 2] = np.abs(normal[:, 2]) + 0.1
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    reflectance = rng.uniform(0.1, 0.9, (problem.n_pixel, 8)).astype(np.float32)
    asked = []

    def solve(*argv):
        asked.append(argv[5])
        return normal, reflectance

    monkeypatch.setattr(decoder.published, "solve", solve)
    fitted = Decoder(RING, Settings(solver="adam", shadows=shadows), FRONTAL, False)(problem)
    np.testing.assert_array_equal(fitted.maps.normal.reshape(-1, 3)[problem.pixel], normal)
    np.testing.assert_array_equal(fitted.maps.reflectance.reshape(-1, 8)[problem.pixel], reflectance)
    assert [settings.robust for settings in asked] == [robust]
    assert fitted.solution.result == STEPS_USED_UP
    assert fitted.solution.n_step == asked[0].n_step == 1600


def test_a_fit_goes_on_from_a_fit(problem):
    """Steps and history are those of the whole fit."""
    solve = Decoder(RING, Settings(priors=()), FRONTAL, True)
    first = solve(problem, None, "rough")
    second = solve(problem, first, "learn")
    n = len(first.solution.history)
    assert second.solution.history[:n] == first.solution.history and len(second.solution.history) > n
    assert second.solution.n_step == sum(passed.steps for passed in second.solution.history)
    assert second.solution.threshold_gain.shape == (problem.n_pixel, 2)


def test_what_is_not_known_keeps_what_its_events_say(problem):
    """Where the model's error is large a pixel is not known, yet its own normal tells more than its neighbour's."""
    solve = Decoder(RING, Settings(priors=()), FRONTAL, False)
    first = solve(problem)
    row, column = np.divmod(problem.pixel, SIZE)
    doubted, silent = column >= SIZE // 2, (row == 8) & (column == 4)
    error = np.zeros_like(first.solution.covariance)
    error[doubted, :2, :2] = 100 * np.eye(2)  # of slopes
    fired = problem.fired & ~silent
    maps = solve.fitted(replace(problem, fired=fired), replace(first.solution, model_error=error)).maps

    def of_pixels(image):
        return image.reshape(SIZE * SIZE, -1)[problem.pixel]

    known, was_known = of_pixels(maps.mask)[:, 0], of_pixels(first.maps.mask)[:, 0]
    assert not known[doubted | silent].any() and was_known[doubted].mean() > 0.9
    for now, before in ((maps.normal, first.maps.normal), (maps.reflectance, first.maps.reflectance)):
        np.testing.assert_array_equal(
            of_pixels(now)[was_known & ~silent], of_pixels(before)[was_known & ~silent]
        )
        near = (np.abs(row - 8) < 2) & (np.abs(column - 4) < 2) & ~silent
        assert (of_pixels(now)[silent] == of_pixels(before)[near]).all(axis=1).any()
    assert (of_pixels(maps.normal_sigma_deg)[doubted | silent] == 180).all()


def test_settings_reach_the_effort():
    balanced = PRESETS["balanced"].effort
    assert choose_effort(Settings()) == balanced
    assert choose_effort(Settings(tolerance=0.7)).tolerance == 0.7
    assert choose_effort(Settings(tolerance=0.7)).priors.tolerance == 0.7
    assert choose_effort(Settings(priors=())).priors is None
    assert choose_effort(Settings(priors=("spectra",))).priors.parts == ("spectra",)
    assert choose_effort(Settings(shadows="downweight")).robust < balanced.robust
