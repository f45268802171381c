"""The test that sigma is true: its statistics, its cases, and its table."""

import json

import numpy as np
import pytest

from evsdr import EventPixel, Maps, Truth
from experiments.sigma import __main__ as command
from experiments.sigma.cases import CASES, CONSTANT_LIGHT, N_LED, Camera, Case, Scene, chosen, load, make
from experiments.sigma.compute import Errors, Row, errors_of
from experiments.sigma.shared import TOLD, draw_case, true_rig
from experiments.sigma.statistics import (
    LEVEL,
    STRIDE,
    keeps_promise,
    level_of_each,
    rank_of_angle,
    rank_of_value,
    shares_within,
    thinned,
    uniformity,
)
from tests.support.foreign_recordings import EVK4_LIKE

SIZE = 12
QUICK = EventPixel(event_noise=0.1).idealised()


def made_up(rng, shape=(40, 40), sigma_deg=2.0, sigma=0.05, factor=1.0, n_band=3):
    """Make maps whose errors are as large as their sigmas, times a factor, and their truth."""
    slope = np.radians(factor * sigma_deg) / np.sqrt(2) * rng.normal(size=(*shape, 2))
    normal = np.dstack([slope, np.ones(shape)])
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    truth = Truth(
        np.broadcast_to([0.0, 0, 1], (*shape, 3)), np.full((*shape, n_band), 0.5), np.ones(shape, bool)
    )
    off = factor * sigma * rng.normal(size=truth.reflectance.shape)
    sigmas = np.full(shape, sigma_deg), np.full((*shape, n_band), sigma)
    return Maps(normal, truth.reflectance + off, truth.mask.copy(), *sigmas, np.arange(3.0)), truth


def row_of(rng, n=4, factor=1.0):
    return Row("made/up", tuple(errors_of(*made_up(rng, factor=factor), seed) for seed in range(n)))


def test_true_sigmas_pass_and_halves_and_doubles_fail(rng):
    for factor, true in ((1.0, True), (0.5, False), (2.0, False)):
        row = row_of(rng, factor=factor)
        for name in ("angle", "reflectance"):
            assert (row.test(name).p > level_of_each(2)) == true
    assert row.mean_square("angle") == pytest.approx(4, rel=0.1)
    assert row.mean_square("reflectance") == pytest.approx(4, rel=0.1)


def test_ranks_of_true_sigmas_are_uniform(rng):
    x, y = rng.normal(size=(2, 20_000))
    for rank in (rank_of_angle(np.hypot(x, y) / np.sqrt(2)), rank_of_value(x)):
        np.testing.assert_allclose(np.quantile(rank, [0.1, 0.5, 0.9]), [0.1, 0.5, 0.9], atol=0.015)
    np.testing.assert_allclose(shares_within(np.hypot(x, y) / np.sqrt(2)), [0.632, 0.982, 0.9999], atol=0.01)


def test_what_a_recording_shares_is_no_evidence(rng):
    """Errors that are the same in all pixels of a recording count once."""
    together = [np.full(50, rng.uniform()) for _ in range(20)]
    single = [rng.uniform(size=50) ** 1.5 for _ in range(20)]
    assert uniformity(together).p > 0.05 and uniformity(together).effect > 20
    assert uniformity(single).p < 1e-4 and uniformity(single).effect < 2
    assert uniformity([np.empty(0)]).p == 1


def test_tests_that_fail_by_chance_are_as_rare_as_told(rng):
    refused = [
        min(uniformity([rng.uniform(size=60) for _ in range(5)]).p for _ in range(8)) < level_of_each(8)
        for _ in range(300)
    ]
    assert np.mean(refused) < 3 * LEVEL
    assert level_of_each(1) == pytest.approx(LEVEL)


def test_pixels_that_count_are_far_from_each_other():
    some = thinned(np.ones((20, 20), bool), 0)
    assert some.sum() == (20 // STRIDE) ** 2
    row, column = np.nonzero(some)
    assert np.diff(np.unique(row)).min() == np.diff(np.unique(column)).min() == STRIDE
    assert (thinned(np.ones((20, 20), bool), 1) != some).any()
    assert not thinned(np.zeros((20, 20), bool), 0).any()


def test_errors_are_those_of_known_pixels(rng):
    maps, truth = made_up(rng)
    maps.mask[:20] = False
    maps.reflectance[:20] += 10
    errors = errors_of(maps, truth, 0)
    assert errors.known == 0.5 and errors.angle.shape == (800,) and errors.reflectance.shape == (800, 3)
    assert np.abs(errors.reflectance).max() < 6
    assert len(errors.angle_ranks) == len(errors.reflectance_ranks) == 800 // STRIDE**2
    doubled = errors_of(maps, truth, 0, factor=2.0)
    np.testing.assert_allclose(2 * doubled.angle, errors.angle)
    np.testing.assert_allclose(2 * doubled.reflectance, errors.reflectance)


def test_the_promise():
    assert keeps_promise(np.array([0.6, 0.9, 0.97]))
    assert not keeps_promise(np.array([0.59, 0.99, 0.99])) and not keeps_promise(np.array([0.9, 0.95, 0.96]))
    assert not keeps_promise(np.full(3, np.nan))


def test_cases_have_names_of_their_own_and_can_be_chosen():
    assert len({case.name for case in CASES}) == len(CASES) == 36
    assert chosen("") == list(CASES)
    assert [case.name for case in chosen("chart/evk4,chart/ideal")] == ["chart/ideal", "chart/evk4"]
    assert len(chosen("foreign")) == 9 and len(chosen("sphere,foreign")) == 12
    with pytest.raises(ValueError, match="no case 'sphree'"):
        chosen("sphree")


@pytest.mark.parametrize(
    "scene", [case.scene for case in CASES if case.camera.name == "ideal"], ids=lambda s: s.name
)
def test_scenes_can_be_recorded(scene):
    told, recording, truth = make(Case(scene, Camera("quick", QUICK)), SIZE, 0)
    assert told.leds.n_led == N_LED and told.constant_light == pytest.approx(CONSTANT_LIGHT)
    assert told.leds.n_band == (1 if scene.white else 8)
    assert told.shape_is_known == (scene.told == scene.file)
    assert len(recording.events) > 50 and np.ndim(recording.sensor.contrast_threshold_on) == 0
    assert truth.mask.sum() > SIZE**2 / 3
    if "texture" in scene.name:
        red = truth.reflectance[truth.mask][:, 7]
        assert red.max() > 1.5 * red.min()


def test_powers_are_told_off_and_the_other_pixel_has_its_dark_current():
    scene = Scene("sphere", "sphere", "sphere", rounds=1)
    true = light_vectors(load("sphere", False, SIZE))
    told, *_ = make(Case(scene, Camera("powers", QUICK, 0.1)), SIZE, 0)
    ratio = np.log(np.linalg.norm(light_vectors(told), axis=1) / np.linalg.norm(true, axis=1))
    assert 0.05 < ratio.std() < 0.15
    np.testing.assert_allclose(np.bincount(told.leds.band, ratio), 0, atol=1e-4)
    told, recording, _ = make(Case(scene, Camera("foreign")), SIZE, 0)
    assert told.constant_light == pytest.approx(CONSTANT_LIGHT + EVK4_LIKE.dark_light)
    assert recording.sensor.refractory_us == EVK4_LIKE.refractory_us


def light_vectors(ring):
    from evsdr.light.tracing import light_at_centre

    return light_at_centre(ring)


def test_truths_are_drawn_from_what_is_told():
    cases = [draw_case(np.random.default_rng(seed)) for seed in range(400)]
    late = np.array([case.wrong.late_us for case in cases])
    tau = 1e6 / (2 * np.pi * np.array([case.watched.pixel.cutoff_hz for case in cases]))
    assert late.std() == pytest.approx(TOLD.shift_us, rel=0.1) and abs(late.mean()) < 5
    assert np.sqrt(np.mean(tau**2)) == pytest.approx(TOLD.tau_us, rel=0.1)
    assert np.std([np.log(case.wrong.on) for case in cases]) == pytest.approx(TOLD.thresholds, rel=0.1)


def test_the_true_rig_is_what_was_drawn(rng):
    from experiments.shared.compute import Rig, record, told_wrong

    case = draw_case(np.random.default_rng(1))
    recording, pixelwise, truth = record(case.watched, "sphere", SIZE, 0)
    rig = Rig(None, np.zeros(N_LED), np.zeros((N_LED, 2)))
    true = true_rig(case, rig, told_wrong(recording, case.wrong), pixelwise, truth)
    assert true.shift * 20_000 == pytest.approx(case.wrong.late_us)
    assert true.refractory * 20_000 == pytest.approx(52)
    np.testing.assert_allclose(true.log_threshold, -np.log([case.wrong.on, case.wrong.off]), atol=0.1)
    assert true.tau > 0 and true.noise > 0 and true.leak > 0


def test_the_table_and_its_files(rng, monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(command, "run", lambda case, size, seeds: Row(case.name, row_of(rng).errors))
    assert command.main(["--cases", "chart", "--out", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert said.count("chart/") == 4 and "63 98 100" in said and "68 95 100" in said
    assert "holds in 4 (normals) and 4 (reflectance)" in said and "refuses not 4 and 4" in said
    rows = json.loads((tmp_path / "sigma.json").read_text())
    assert [row["case"] for row in rows][0] == "chart/ideal" and len(rows[0]["bands_within_1_sigma"]) == 3
    assert (tmp_path / "sigma.png").stat().st_size > 5000


def test_nothing_known_is_nothing_kept():
    none = np.empty(0)
    row = Row("a", (Errors(0.0, 90.0, 90.0, 1.0, none, none.reshape(0, 8), none, none),))
    assert command.cells(row)[-2] == "no no"
    assert row.test("angle").p == 1 and row.beyond() == 0
