"""The benchmark in kind: its frames, its events, and that each baseline solves what it must solve exactly."""

import json

import numpy as np
import pytest
from evsdr.scenes.formats import Mesh, write_ply

from evsdr import Truth, angular_error_deg
from experiments.table1 import __main__ as command
from experiments.table1 import frames, methods, two_stage
from experiments.table1.cases import N_STATE, draw_case, led_directions, list_cases, texture
from experiments.table1.event_maker import EPS, make_events, slot_frames
from experiments.table1.recordings import SHOT_LEDS, checksums, scene_xml, shoot

N_PIXEL = 40
LIGHT = led_directions(40.0)[SHOT_LEDS]
LIGHT = LIGHT[np.argsort(SHOT_LEDS % 8)]


@pytest.fixture
def normal(rng) -> np.ndarray:
    """Give normals that all lights reach."""
    slope = rng.uniform(-0.5, 0.5, (N_PIXEL, 2))
    return np.column_stack([slope, np.ones(N_PIXEL)]) / np.sqrt(1 + (slope**2).sum(axis=1, keepdims=True))


def test_multiplexed_frames_are_solved_exactly(rng, normal):
    spectra = rng.uniform(0.2, 0.9, (3, 8))
    true = rng.dirichlet(np.ones(3), N_PIXEL) @ spectra
    found, reflectance = frames.solve_multiplexed(true * (normal @ LIGHT.T), LIGHT, spectra)
    assert np.median(angular_error_deg(found, normal)) < 1e-3  # a few pixels have a second minimum
    np.testing.assert_allclose(np.median(np.abs(reflectance - true)), 0, atol=1e-5)


def test_reciprocals_in_a_known_space_are_solved_exactly(rng, normal):
    reciprocal = rng.uniform(1.2, 5.0, (3, 8))
    true = 1 / (rng.dirichlet(np.ones(3), N_PIXEL) @ reciprocal)
    found, reflectance = frames.solve_reciprocal(true * (normal @ LIGHT.T), LIGHT, 1 / reciprocal)
    assert angular_error_deg(found, normal).max() < 1e-6
    np.testing.assert_allclose(reflectance, true, rtol=1e-9)


def test_one_chromaticity_is_solved_exactly(rng, normal):
    true = rng.uniform(0.1, 1.0, (N_PIXEL, 1)) * rng.uniform(0.2, 0.9, 8)
    found, reflectance = frames.solve_one_chromaticity(true * (normal @ LIGHT.T), LIGHT)
    assert angular_error_deg(found, normal).max() < 1e-6
    factor = (reflectance / true).mean()
    np.testing.assert_allclose(np.minimum(reflectance, 0.99), np.minimum(factor * true, 0.99), rtol=1e-6)


def test_two_stages_solve_events_without_noise(rng, normal):
    shape, light = (5, 8), led_directions(40.0)
    true = rng.uniform(0.2, 0.9, (N_PIXEL, 8))
    white = np.maximum(light @ normal.T, 0).reshape(-1, *shape)
    frontal = (true * normal[:, 2:]).T.reshape(-1, *shape)
    given = 20_000.0, 1, 0.05, 0.0, 100.0, 1
    stages = {
        "normal": (make_events(white, 0.0, np.arange(24), *given), np.arange(24), 20_000.0),
        "spectrum": (make_events(frontal, 0.2, np.arange(-1, 8), *given), np.arange(-1, 8), 20_000.0),
    }
    found, reflectance = two_stage.solve_stages(stages, light, 0.05, 100.0, 0.2 + EPS, shape)
    assert angular_error_deg(found.reshape(-1, 3), normal).mean() < 0.3
    error = np.abs(
        reflectance.reshape(-1, 8) / true - 1
    )  # where two bands differ by less than C, no event tells
    assert np.median(error) < 0.01 and np.mean(error < 0.05) > 0.99


def test_events_fire_where_the_line_between_frames_crosses():
    light = np.array([1.0, np.e - EPS, 1.0]).reshape(3, 1, 1)
    light[[0, 2]] -= EPS
    e = make_events(light[:2], 0.0, np.arange(2), 1600.0, 1, 0.3, 0.0, 0.0, 0)
    frame = np.log(slot_frames(light[:2].reshape(2, 1), 16) + EPS)[:, 0]
    times = 100.0 * np.arange(33)
    expected = np.interp([0.3, 0.6, 0.9], frame[:17], times[:17])
    np.testing.assert_allclose(e.t[:3], expected, atol=0.51)
    np.testing.assert_array_equal(e.p, [1, 1, 1, 0, 0])  # the sixth would fire when it ends


def test_what_changes_while_a_pixel_rests_is_lost():
    light = np.array([1.0, np.e]).reshape(2, 1, 1)
    given = light, 0.0, np.arange(2), 1600.0, 1, 0.3, 0.0
    t = make_events(*given, 200.0, 0).t
    times = 100.0 * np.arange(17)
    level = np.log(slot_frames(light.reshape(2, 1), 16)[:17, 0] + EPS)
    again = np.interp(np.interp(t[0] + 200, times, level) + 0.3, level, times)
    np.testing.assert_allclose(t[1], again, atol=1.5)


def test_light_that_does_not_change_fires_nothing():
    assert len(make_events(np.ones((2, 1, 1)), 0.1, np.arange(2), 1600.0, 3, 0.1, 0.3, 300.0, 0)) == 0


def test_stock_renders_have_the_units_of_the_truth(tmp_path):
    from experiments.table1 import render

    tilt = np.array([np.sin(0.4), 0.0, np.cos(0.4)])
    corner = np.array([[-3, -3, 0], [3, -3, 0], [3, 3, 0], [-3, 3, 0.0]])
    corner[:, 2] = -corner[:, 0] * tilt[0] / tilt[2]
    write_ply(
        tmp_path / "o.ply",
        Mesh(corner, np.tile(tilt, (4, 1)), corner[:, :2] / 6 + 0.5, np.array([[0, 1, 2], [0, 2, 3]])),
    )
    case = draw_case("blobs", 0, 1)
    matt = type(case)(**(vars(case) | {"gloss": 0.0}))
    light = led_directions(50.0)[[0, 7]]
    grey = np.full((2, 2), 0.4)
    image = render.shots(matt, tmp_path / "o.ply", grey, light, 4, 4)
    np.testing.assert_allclose(
        image, np.broadcast_to(0.4 * (light @ tilt)[:, None, None], image.shape), rtol=1e-4
    )
    normal, true, covered = render.truth(tmp_path / "o.ply", grey[..., None], 4)
    np.testing.assert_allclose(normal[covered], np.tile(tilt, (16, 1)), atol=1e-5)
    np.testing.assert_allclose(true, 0.4, rtol=1e-5)


def test_textures_have_the_rank_that_is_asked_for():
    for bases in (1, 3, 8):
        flat = texture(draw_case("blobs", 1, bases)).reshape(-1, 8)
        assert np.linalg.matrix_rank(flat, tol=1e-9) == bases and 0 < flat.min() and flat.max() < 0.96


def test_cases_stay_within_the_ranges_of_the_paper():
    cases = list_cases()
    assert sum(c.dataset == "blobs" for c in cases) == 30
    for c in cases:
        assert 30 <= c.polar_deg <= 60 and 0.05 <= c.noise <= 0.35 and 0.8 <= c.told <= 1.2
        assert 0.2 <= 6 * 24 * c.slot_us / 1e6 + 1e-4 and 6 * 24 * c.slot_us / 1e6 <= 0.4001


def test_a_rainbow_has_each_colour_three_times():
    case, paper = draw_case("blobs", 2, 3, N_STATE), draw_case("blobs", 2, 3)
    assert len(case.band_nm) == 32 and np.diff(case.band_nm).max() < 8
    assert case.n_led * case.slot_us == pytest.approx(24 * paper.slot_us, rel=0.01)  # the same round
    assert case.name != paper.name and (case.noise, case.told) == (paper.noise, paper.told)
    assert texture(case).shape == (case.texels, case.texels, 32)
    found = scene_xml(case, 8)
    assert found.count("<emitter") == 96 and found.count('value="400.0:0, 405.0:0.2') == 3
    azimuth = np.unwrap(np.arctan2(*led_directions(40.0, N_STATE)[:, 1::-1].T))
    np.testing.assert_allclose(np.diff(azimuth), np.radians(3.75))


def test_shots_are_averaged_to_the_light():
    case, signal = draw_case("blobs", 0, 1), np.full((8, 30, 30), 0.3)
    np.testing.assert_allclose(shoot(case, signal).mean(), 0.3, rtol=1e-3)


def test_one_factor_is_given_to_what_is_not_absolute(rng):
    true = rng.uniform(0, 1, (3, 4, 8))
    truth = Truth(np.zeros((3, 4, 3)), true, np.ones((3, 4), bool))
    np.testing.assert_allclose(methods.scaled(truth.normal, 5 * true, truth).reflectance, true)


def test_the_table_has_the_papers_figures_beside(capsys, tmp_path):
    score = {"mae_deg": 2.0, "sam_deg": 1.0, "rmse": 0.01, "scaled_rmse": 0.01, "mib": 13.0, "seconds": 3.0}
    command.print_row("blobs", 1, "two stages", [score, None])
    assert capsys.readouterr().out.count("9.61 | 9.1 | 0.0302 | 13.31") == 1
    (tmp_path / "truth.npz").write_bytes(b"")
    assert checksums(tmp_path).startswith("e3b0c44298fc1c14")
    (tmp_path / "scores.json").write_text(json.dumps({"a": score}))
    assert command.read_scores(tmp_path)["a"] == score
