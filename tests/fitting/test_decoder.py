"""The solvers with their settings: the published one stays as published, ours goes on from where it was."""

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


def test_settings_reach_the_effort():
    balanced = PRESETS["balanced"].effort
    assert choose_effort(Settings()) == balanced
    assert choose_effort(Settings(tolerance=0.7)).tolerance == 0.7
    assert choose_effort(Settings(tolerance=0.7)).priors.tolerance == 0.7
    assert choose_effort(Settings(priors=())).priors is None
    assert choose_effort(Settings(priors=("spectra",))).priors.parts == ("spectra",)
    assert choose_effort(Settings(shadows="downweight")).robust < balanced.robust
