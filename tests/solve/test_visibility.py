"""What pixels see of the LEDs is found from their events, where something hides some."""

from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from evsdr.events.pairs import pair_events
from evsdr.model.gloss import BlinnPhong
from evsdr.solve import visibility
from evsdr.solve.guesses import IMPOSSIBLE, Judge
from evsdr.solve.problem import make_problem
from evsdr.solve.stages import ALL_TERMS
from evsdr.solve.unknowns import normal_sigma_deg
from evsdr.solve.visibility import doubtful, find_visibility, left_open, unhide
from tests.support.analytic import lambert_signals, ring_directions, sphere_normals
from tests.support.glossy import lobe_signals
from tests.support.sphere import SPECTRUM, errors, record_signal, ring_light, solve

SIZE = 20
COPIES = 4  # operations of a kernel that only copies
SOFT = np.ones(24)
SOFT[3:12] = 0.8, 0.5, 0.2, 0, 0, 0, 0.2, 0.5, 0.8  # of an arc whose edges are soft
LOBE = BlinnPhong, 20.0, 0.6  # kind, shininess, strength
HIDDEN = np.arange(5, 10)  # LEDs that a wall hides from the upper right quarter


@pytest.fixture(scope="module")
def shadowed():
    """A sphere, a quarter of which does not see five LEDs: the problem, its solution without that, truth and quarter."""
    normal, mask = sphere_normals(SIZE)
    signal = lambert_signals(normal, np.broadcast_to(SPECTRUM, (SIZE, SIZE, 8)), ring_directions())
    signal = np.where(mask, signal, 0)
    quarter = np.zeros_like(mask)
    quarter[: SIZE // 2, SIZE // 2 :] = True
    signal[HIDDEN] = np.where(quarter, 0, signal[HIDDEN])
    recording = record_signal(signal, event_noise=0.02)
    problem = make_problem(recording, pair_events(recording, mask), ring_light(), mask)
    return problem, solve(problem), normal[mask], quarter[mask]


def everything(problem):
    return np.ones((24, problem.n_pixel), np.float32)


@pytest.fixture(scope="module")
def seen(shadowed):
    problem, solution, *_ = shadowed
    return find_visibility(problem, solution, everything(problem))


def is_lit(truth):
    """Tell which LEDs a surface clearly faces: others may be hidden or not."""
    return ring_directions() @ truth.T > 0.25


def test_hidden_leds_are_found_and_no_others(shadowed, seen):
    _, _, truth, quarter = shadowed
    lit = is_lit(truth)
    real = np.isin(np.arange(24), HIDDEN)[:, None] & quarter & lit
    assert np.mean(seen.share[real] < 0.5) > 0.8
    assert np.mean(seen.share[lit & ~real] > 0.5) > 0.98
    assert seen.explained > 0.7 and seen.share.dtype == np.float32


def test_maps_come_with_it(shadowed, seen):
    problem, solution, truth, quarter = shadowed
    before = errors(solution, truth)[0][quarter].mean()
    after = errors(replace(solution, theta=seen.theta), truth)[0][quarter].mean()
    assert before > 8 and after < 0.4 * before


def test_soft_edges_are_found(monkeypatch):
    """Hard arcs fit soft edges badly: where noise counts as it is from the first, other arcs fit as well.

    The probe with hard arcs misses these edges in every second draw, so it is left out.
    """
    monkeypatch.setattr(visibility, "LEAST_EXPLAINED", -np.inf)
    normal, mask = sphere_normals(14)
    signal = lambert_signals(normal, np.broadcast_to(SPECTRUM, (14, 14, 8)), ring_directions())
    signal = np.where(mask, signal, 0)
    signal[:, :7, 7:] *= SOFT[:, None, None]
    recording = record_signal(signal, event_noise=0.02)
    problem = make_problem(recording, pair_events(recording, mask), ring_light(), mask)
    seen = find_visibility(problem, solve(problem), everything(problem))
    row, column = np.nonzero(mask)
    quarter = (row < 7) & (column >= 7)
    off = np.abs(seen.share - SOFT[:, None]) * is_lit(normal[mask])
    assert off[:, quarter].sum(axis=0).mean() < 1


def test_a_guess_that_stands_alone_asks_for_no_kernel_of_its_own(shadowed):
    problem, solution, *_ = shadowed
    judge, share = visibility._judge(problem, solution, None, False), everything(problem)

    def ask(*pixel):
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
            dr.kernel_history()
            told = judge(np.array(pixel), share[:, pixel], solution.all_theta[list(pixel)], ((None, 3),))
            kernels = [kernel for kernel in dr.kernel_history() if "hash" in kernel]
        # Not those that copy NumPy's memory: there are two, by how it lies
        return *told, {kernel["hash"] for kernel in kernels if kernel["operation_count"] > COPIES}

    before = ask(9, 11)[-1]
    theta, cost, several = ask(7, 9)
    alone, its_cost, kernels = ask(7)
    assert kernels and kernels <= several | before
    np.testing.assert_allclose(alone, theta[:1])
    np.testing.assert_allclose(its_cost, cost[:1])


def test_what_stays_keeps_its_maps(shadowed, seen):
    same = (seen.share == 1).all(axis=0)
    assert same.sum() > 100 and (seen.gain[same] == 0).all() and (seen.gain[~same] > 0).all()
    np.testing.assert_array_equal(seen.theta[same], shadowed[1].all_theta[same])


def test_nothing_is_found_where_nothing_hides(monkeypatch):
    normal, mask = sphere_normals(12)
    signal = lambert_signals(normal, np.broadcast_to(SPECTRUM, (12, 12, 8)), ring_directions())
    recording = record_signal(np.where(mask, signal, 0), event_noise=0.02)
    problem = make_problem(recording, pair_events(recording, mask), ring_light(), mask)
    found = find_visibility(problem, solve(problem), everything(problem))
    assert (found.share == 1).all() and not found.untold.any() and not found.gain.any()


def test_few_pixels_teach_the_others(shadowed, seen, monkeypatch):
    """Arcs are tried in some of the pixels, whose neighbours are as far apart; the probe asks all of these few."""
    problem, solution, truth, quarter = shadowed
    tried, steps = [], []
    arcs, neighbours = visibility._try_arcs, visibility._try_neighbours
    monkeypatch.setattr(visibility, "_try_arcs", lambda *given: tried.append(len(given[2])) or arcs(*given))
    monkeypatch.setattr(
        visibility, "_try_neighbours", lambda *given: steps.append(given[3]) or neighbours(*given)
    )
    monkeypatch.setattr(visibility, "ENOUGH", 10)
    found = find_visibility(problem, solution, everything(problem))
    lit = is_lit(truth)
    assert np.mean((found.share < 0.5) == (seen.share < 0.5), where=lit) > 0.98
    assert 0 < tried[1] < 0.4 * tried[0] and steps[0] > 1 and steps[-1] == 1


def test_a_wrong_trace_is_overruled_and_a_right_one_taken(shadowed):
    problem, solution, truth, quarter = shadowed
    right = everything(problem)
    right[np.ix_(HIDDEN, quarter)] = 0
    wrong = everything(problem)
    wrong[np.ix_(HIDDEN, ~quarter)] = 0
    lit = is_lit(truth)
    for traced, share in ((right, 0.97), (wrong, 0.9)):
        found = find_visibility(problem, solution, everything(problem), traced)
        assert np.mean((found.share < 0.5) == (right < 0.5), where=lit) > share


def test_what_is_traced_is_tried_as_it_is(shadowed, monkeypatch):
    """Without arcs and small changes."""
    problem, solution, truth, quarter = shadowed
    monkeypatch.setattr(visibility, "_try_arcs", lambda judge, best, *_: best)
    monkeypatch.setattr(visibility, "N_ROUND", 0)
    traced, given = everything(problem), everything(problem)
    traced[np.ix_(HIDDEN, quarter)] = 0
    given[23, 0] = 0  # something is known already, so that no search is needed to tell
    found = find_visibility(problem, solution, given, traced)
    lit = is_lit(truth)[:, quarter]
    assert np.mean((found.share == traced)[:, quarter], where=lit) > 0.9


def test_a_search_can_be_ended_soon(shadowed, monkeypatch):
    """With what is known by then."""
    problem, solution, *_ = shadowed
    asked, fit = [], Judge._fit
    monkeypatch.setattr(
        Judge, "_fit", lambda judge, pixel, *rest: asked.append(pixel) or fit(judge, pixel, *rest)
    )
    find_visibility(problem, solution, everything(problem))
    whole = sum(map(len, asked))
    asked.clear()
    given = everything(problem)
    given[23, 0] = 0  # something is known already, so that no search is needed to tell
    found = find_visibility(problem, solution, given, enough=lambda: True)
    assert sum(map(len, asked)) < 0.1 * whole and found.share.shape == given.shape
    assert np.isfinite(found.theta).all()


def test_shadows_of_a_known_shape_leave_no_pixel_untold(shadowed, monkeypatch):
    """Its visibility is told by more than the events."""
    problem, solution, *_ = shadowed
    monkeypatch.setattr(visibility, "untold", lambda problem, share, theta: np.ones(problem.n_pixel, bool))
    assert not find_visibility(problem, solution, everything(problem), everything(problem), True).untold.any()
    assert find_visibility(problem, solution, everything(problem), everything(problem)).untold.all()


def test_pixels_that_hardly_an_led_reaches_are_untold(shadowed):
    """With eleven lit LEDs, ten unknowns and one to spare, any visibility does."""
    problem, solution, *_ = shadowed
    given = everything(problem)
    given[11:, 0], given[12:, 1], given[0, 2] = 0, 0, 0
    theta = solution.theta.copy()
    theta[:, :2] = 0
    frontal = replace(solution, theta=theta)
    untold = visibility.untold(problem, given, frontal.theta)
    assert untold[0] and not untold[1] and not untold[2] and not untold[3:].any()


def test_sigma_holds_what_other_visibility_would_make(shadowed, seen):
    """At the border, where a pixel is told too few hidden LEDs, what its neighbours see is as likely or likelier."""
    problem, solution, truth, quarter = shadowed
    found = replace(solution, theta=seen.theta)
    sure = sigma_of(found, left_open(problem, found, seen.share, everything(problem), False))
    blind = left_open(problem, solution, seen.share, everything(problem), False)
    error = errors(solution, truth)[0]
    assert np.median(sure) < 1
    assert np.mean(sigma_of(solution, blind)[quarter] > 0.7 * error[quarter]) > 0.7
    wrong = np.flatnonzero(quarter)[0]
    share, theta = seen.share.copy(), seen.theta.copy()
    share[:, wrong], theta[wrong] = 1, solution.theta[wrong]
    told = replace(solution, theta=theta)
    open_there = sigma_of(told, left_open(problem, told, share, everything(problem), False))[wrong]
    assert open_there > 0.7 * error[wrong] > 5 * sure[wrong]


def test_a_guess_under_which_events_cannot_be_has_a_cost(shadowed, seen):
    problem, solution, *_ = shadowed
    share = seen.share.copy()
    share[:, 3] = np.nan
    judge = visibility._judge(problem, solution, None, False)
    cost = judge._fit(np.arange(2, 4), share[:, 2:4], seen.theta[2:4], ((None, 1),), ALL_TERMS)[1]
    assert cost[0] < IMPOSSIBLE == cost[1]


def test_guesses_that_cost_a_little_more_are_not_ruled_out(shadowed, seen, monkeypatch):
    problem, solution, *_ = shadowed
    found, given = replace(solution, theta=seen.theta), (seen.share, everything(problem), False)
    wide = sigma_of(found, left_open(problem, found, *given))
    monkeypatch.setattr(visibility, "OPEN", 1.0)
    narrow = sigma_of(found, left_open(problem, found, *given))
    shaded = (seen.share < 0.5).any(axis=0)
    assert np.mean(wide[shaded] > 3 * narrow[shaded]) > 0.3 and np.median(wide) < 1


def sigma_of(solution, error):
    """Give the standard deviation of normals [deg] by a covariance of maps."""
    return normal_sigma_deg(*solution.theta[:, :2].astype(float).T, error[:, :2, :2])


def test_little_of_an_led_is_doubtful_where_others_tell_as_much():
    share, band = np.ones((8, 5)), [0, 1] * 4
    share[0, 0] = 0.2  # doubtful
    share[[0, 1], 1] = 0.6, 0  # enough is seen, and nothing
    share[[0, 1, 2], 2] = 0.2  # too many
    share[[0, 2, 4], 3] = 0, 0.2, 0  # too few of the band would be left
    share[[0, 3], 4] = 0.1
    expected = np.zeros(share.shape, bool)
    expected[0, 0] = expected[[0, 3], 4] = True
    np.testing.assert_array_equal(doubtful(share, band), expected)


# ---------------------------------------------------------------------- gloss that passes for shadow


@pytest.fixture(scope="module")
def glossy():
    """A glossy sphere with such a quarter: the problem, its matt solution and what that sees, and what is hidden indeed."""
    normal, mask = sphere_normals(SIZE)
    signal = lambert_signals(normal, np.broadcast_to(SPECTRUM, (SIZE, SIZE, 8)), ring_directions())
    signal += lobe_signals(*LOBE, normal, ring_directions())
    quarter = np.zeros_like(mask)
    quarter[: SIZE // 2, SIZE // 2 :] = True
    signal[HIDDEN] = np.where(quarter, 0, signal[HIDDEN])
    recording = record_signal(np.where(mask, signal, 0), event_noise=0.02)
    problem = make_problem(recording, pair_events(recording, mask), ring_light(), mask)
    solution = solve(problem)
    seen = find_visibility(problem, solution, everything(problem))
    hidden = np.isin(np.arange(24), HIDDEN)[:, None] & quarter[mask] & is_lit(normal[mask])
    return problem, replace(solution, theta=seen.theta), seen.share, hidden, normal[mask]


def with_lobe(problem, strength):
    kind, shape, _ = LOBE
    lobe = kind(*(dr.full(mi.Float, v, problem.n_pixel) for v in (shape, strength)))
    return replace(problem, lobe=lobe)


@pytest.mark.parametrize("believed", [LOBE[2], 0.0])
def test_lobes_light_what_a_matt_model_takes_for_hidden(glossy, believed):
    """Also where a wrong guess has told that a pixel has no lobe."""
    problem, solution, share, hidden, truth = glossy
    problems = [with_lobe(problem, strength) for strength in (believed, LOBE[2])]
    after, theta = unhide(problems, solution, share)
    wrong = (share < 0.5).any(axis=0) & ~hidden.any(axis=0)
    assert wrong.sum() > 20 and (after[:, wrong] == 1).all(axis=0).mean() > 0.9
    before, mended = (errors(replace(solution, theta=t), truth)[0][wrong] for t in (solution.theta, theta))
    assert before.mean() > 4 and mended.mean() < 0.5


def test_real_shadows_on_gloss_stay(glossy):
    problem, solution, share, hidden, _ = glossy
    after, theta = unhide([with_lobe(problem, LOBE[2])] * 2, solution, share)
    assert np.mean(share[hidden] < 0.5) > 0.9
    np.testing.assert_array_equal(after[hidden], share[hidden])
    same = (after == share).all(axis=0)
    assert (theta[same] == solution.all_theta[same]).all()


def test_where_nothing_is_hidden_no_event_is_asked(glossy, monkeypatch):
    problem, solution, *_ = glossy
    monkeypatch.setattr(visibility.Judge, "__call__", None)
    share, theta = unhide([problem], solution, everything(problem))
    assert (share == 1).all() and theta is solution.all_theta
