"""Pixels that tell, with their events and their light."""

from dataclasses import replace
from types import SimpleNamespace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from evsdr.model.arrays import owned
from evsdr.model.gloss import RoughCoating
from evsdr.model.illumination import Illumination
from evsdr.model.lambert import signals_of
from evsdr.solve.shared.pixels import (
    FEWEST_EVENTS,
    FEWEST_PIXELS,
    SHORTEST,
    Nearer,
    choose,
    collect,
    is_far,
    stirred_values,
    turned,
    vector_of,
)
from evsdr.solve.shared.rig import across
from tests.support.shared_unknowns import N_LED, Case
from tests.support.sphere import C_W, ring_light


@pytest.fixture(scope="module")
def case():
    return Case.sphere(size=14, event_noise=0.05)


def test_pixels_that_tell_are_chosen(case):
    problem, solution = case.problem, case.solution
    mask, row = problem.grid.mask, choose(problem, solution, 1000)
    y, x = np.divmod(problem.pixel[row], mask.shape[1])
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            assert mask[y + dy, x + dx].all()  # none at the rim
    assert problem.pairs.counts[row].min() >= FEWEST_EVENTS[0]
    loud = replace(solution, noise_factor=np.where(np.arange(problem.n_pixel) == row[3], 5.0, 1.0))
    assert row[3] not in choose(problem, loud, 1000) and row[4] in choose(problem, loud, 1000)
    some = choose(problem, solution, 10)
    assert len(set(some)) == 10 and set(some) <= set(row) and (np.diff(some) > 0).all()


def test_fewer_pixels_tell_where_each_has_many_events(case, monkeypatch):
    """But some, however many they have; those are among the others."""
    count = case.problem.pairs.counts
    row, total = choose(case.problem, case.solution, 30), count[count >= FEWEST_EVENTS[0]].sum()
    monkeypatch.setattr("evsdr.solve.shared.pixels.FEWEST", 4)
    for most, fewest, whole in ((0.25 * total, 5, False), (1, 4, True), (total, 30, True)):
        monkeypatch.setattr("evsdr.solve.shared.pixels.MOST_EVENTS", most)
        some = choose(case.problem, case.solution, 30)
        assert set(some) <= set(row) and (np.diff(some) > 0).all()
        assert len(some) == fewest if whole else fewest <= len(some) < 30 and count[some].sum() <= most


@pytest.mark.parametrize(("many", "n"), [(0, 0), (FEWEST_PIXELS - 1, None), (FEWEST_PIXELS, FEWEST_PIXELS)])
def test_pixels_of_fewer_events_tell_where_hardly_any_have_many(case, many, n):
    """But not of less than that."""
    few, much = FEWEST_EVENTS[1], FEWEST_EVENTS[0]
    inner = choose(case.problem, case.solution, 1000)
    counts = np.full(case.problem.n_pixel, few if n is None else few - 1)
    counts[inner[:many]] = much
    problem = replace(case.problem, pairs=SimpleNamespace(counts=counts))
    assert len(choose(problem, case.solution, 1000)) == (len(inner) if n is None else n)


def test_pixels_that_tell_lie_off_the_rim_of_where_events_end(case):
    """A mask may hold silent background; a silent spot within the object is no rim; a thin object has what it has."""
    mask, pairs = case.problem.grid.mask, case.problem.pairs
    y, x = np.nonzero(mask)
    centre, left = (y == 7) & (x == 7), x < 7

    def chosen(silent, most=1):
        counts = np.where(silent, 0, 50)
        problem = replace(case.problem, pairs=SimpleNamespace(counts=counts))
        return choose(problem, case.solution, most)

    def distance_to(row, of):
        return min(max(abs(y[i] - v), abs(x[i] - u)) for i in row for v, u in zip(y[of], x[of]))

    assert len(pairs.counts) == mask.sum()
    assert distance_to(chosen(left, 1000), left) == 2 and distance_to(chosen(left), left) == 3
    assert distance_to(chosen(centre, 1000), centre) == 1


def test_what_has_no_lag_has_none_in_the_dark(case):
    """A thousandth of the usual light makes a photoreceptor a thousand times slower."""
    for veil, expected in ((0.05, 1.0), (5e-5, 1e-3), (50.0, 1.0), (0.0, 2e-8)):
        light = replace(case.pixels.light, constant_light=mi.Float(veil))
        pixels = replace(case.pixels, model=replace(case.pixels.model, illumination=light))
        assert pixels.dimness == pytest.approx(expected)
    rig = replace(case.told, tau=1e-7)
    assert stirred_values(rig, ())[0, 0] == SHORTEST and stirred_values(rig, (), 1e-9)[0, 0] == 1e-7


def test_events_of_the_chosen_are_collected(case):
    events, (offset, at, gap, polarity, inside, ending) = case.recording.events, case.pixels.events
    slot_us, rounds = case.recording.schedule.slot_us, case.recording.round_start_us
    assert len(offset) == len(case.row) + 1 == len(ending) + 1 and case.pixels.n_event == offset[-1] == len(
        at
    )
    for i in (0, 7, len(case.row) - 1):
        y, x = divmod(case.problem.pixel[case.row[i]], 14)
        mine = (events.x == x) & (events.y == y)
        part = slice(offset[i], offset[i + 1])
        t = events.t[mine]
        np.testing.assert_allclose(at[part], t / slot_us % N_LED)
        np.testing.assert_array_equal(polarity[part], 2 * events.p[mine] - 1)
        np.testing.assert_allclose(gap[part][1:], np.diff(t) / slot_us)
        assert ending[i] == pytest.approx((rounds[-1] - t[-1]) / slot_us) and inside[part][1:].all()
    assert case.pixels.leds.tolist() == list(range(N_LED))
    np.testing.assert_array_equal(case.pixels.threshold, np.full((len(case.row), 2), np.float32(0.2)))


def test_signals_are_those_of_the_model_times_the_powers(case):
    theta = case.solution.theta[case.row].astype(float)
    dark = case.pixels.signals(theta, case.told)
    expected = signals_of(case.problem.model, case.solution.theta)[:N_LED, case.row].T
    lit = expected > 0.1
    np.testing.assert_allclose(dark[:, 0][lit], expected[lit], rtol=1e-3)
    bright = case.pixels.signals(theta, replace(case.told, log_power=np.linspace(-0.2, 0.2, N_LED)))
    np.testing.assert_allclose(bright, dark * np.exp(np.linspace(-0.2, 0.2, N_LED)), rtol=1e-6)


def test_signals_have_the_lobes_of_a_glossy_problem(case):
    """Of one strength to the left, of another to the right."""
    n, theta = case.problem.n_pixel, case.solution.theta
    lobe = RoughCoating(mi.Float(0.3), owned(mi.Float, np.linspace(0.2, 2.0, n)))
    glossy = replace(case.problem, lobe=lobe)
    pixels = collect(case.recording, glossy, case.solution, case.row)
    found = pixels.signals(theta[case.row].astype(float), case.told)[:, 0]
    expected, matt = (signals_of(p.model, theta)[:N_LED, case.row].T for p in (glossy, case.problem))
    lit = expected > 0.1
    np.testing.assert_allclose(found[lit], expected[lit], rtol=1e-3)
    assert np.max((expected - matt)[lit]) > 0.05


def test_signals_follow_turned_leds_as_told(case):
    theta, h = case.solution.theta[case.row].astype(float), 1e-3
    told = case.pixels.tilts(theta, case.told)
    for j, k in ((0, 0), (5, 1), (17, 0)):
        tilt = np.zeros((N_LED, 2))
        tilt[j, k] = h
        high, low = (case.pixels.signals(theta, replace(case.told, tilt=s * tilt))[:, 0] for s in (1, -1))
        lit = low[:, j] > 0.4 * low[:, j].max()
        assert lit.sum() > 5
        change = np.log(high[lit, j] / low[lit, j]) / (2 * h)
        np.testing.assert_allclose(told[lit, j, k], change, atol=0.01)
        np.testing.assert_array_equal(np.delete(high, j, axis=1), np.delete(low, j, axis=1))


@pytest.mark.parametrize("softness", [1e-3, 0.2])
def test_derivatives_by_direction_hold_up_to_the_horizon(case, softness):
    """Also where LEDs are turned already, and where they have set behind a soft horizon."""
    theta, h = case.solution.theta[case.row].astype(float), 1e-2
    pixels = replace(case.pixels, softness=mi.Float(softness) + dr.zeros(mi.Float, len(theta)))
    rig = replace(case.told, tilt=np.random.default_rng(0).normal(0, 0.05, (N_LED, 2)))
    now, tilts = pixels.signals(theta, rig)[:, 0], pixels.tilts(theta, rig)
    for k in range(2):
        step = np.zeros((N_LED, 2))
        step[:, k] = h
        high, low = (pixels.signals(theta, replace(rig, tilt=rig.tilt + s * step))[:, 0] for s in (1, -1))
        change = (high - low) / (2 * h)
        away = np.abs(now * tilts[..., k] - change) / np.abs(change).max()
        assert away[now > 1e-4].max() < (0.003 if softness > h else 0.3)
        assert np.mean(away) < 1e-3


def test_directions_turn_by_the_angle():
    light, tilt = ring_light(), np.zeros((N_LED, 2))
    tilt[3] = 0.02, -0.01
    new = turned(light, tilt)
    before, after = (np.array([vector_of(d) for d in of.direction]) for of in (light, new))
    np.testing.assert_allclose(np.delete(after, 3, 0), np.delete(before, 3, 0), atol=1e-6)
    np.testing.assert_allclose(across(before[3]) @ after[3], tilt[3], rtol=1e-3)
    assert np.linalg.norm(after[3]) == pytest.approx(1, abs=1e-6) and is_far(new)


def test_the_shortest_time_between_events_is_that_of_a_pixel(case):
    """But for one in a thousand; the first event of a pixel follows none."""
    offset, at, gap, *rest = case.pixels.events
    spaced = np.full(len(gap), 0.4)
    spaced[offset[:-1]] = 0.0
    spaced[offset[3] + 2] = 0.1
    assert replace(case.pixels, events=(offset, at, spaced, *rest)).shortest == pytest.approx(0.4)
    few = (np.array([0, 1, 2]), at[:2], gap[:2], *rest)
    assert replace(case.pixels, events=few).shortest == np.inf


@pytest.mark.parametrize("by", [-0.7, 0.0, 0.3, 0.9])
def test_light_of_point_leds_is_right_wherever_the_surface_is(by):
    """Between the three places where it is traced, too; LEDs that are hidden in part, or of other power, stay so."""
    rng = np.random.default_rng(0)
    place, led = rng.uniform(-1, 1, (3, 50)), np.array([2.0, 0.5, 2.5])

    def light(by, factor=1.0):
        way = led[:, None] - place - [[0], [0], [by]]
        square = np.sum(way**2, axis=0)
        direction = mi.Vector3f(*(mi.Float(c.astype(np.float32)) for c in way / np.sqrt(square)))
        return Illumination(
            [direction], [mi.Float((factor / square).astype(np.float32))], [0], mi.Float(0.05)
        )

    found = Nearer(1.0, tuple(light(z) for z in (-1, 0, 1)))(light(0, 0.3), by)
    expected = light(by, 0.3)
    np.testing.assert_allclose(np.array(found.direction[0]), np.array(expected.direction[0]), atol=1e-5)
    np.testing.assert_allclose(found.irradiance[0].numpy(), expected.irradiance[0].numpy(), rtol=1e-5)


def test_signals_have_their_derivative_by_distance(case):
    """Of a surface that LEDs are near to; without one there are four rows only."""
    theta, n = case.solution.theta[case.row].astype(float), len(case.row)
    far = case.pixels.light

    def light(by):
        wide = [
            type(d)(*(c + 0.1 * by * (k == 0) + dr.zeros(mi.Float, n) for k, c in enumerate(d)))
            for d in far.direction
        ]
        return replace(
            far, direction=wide, irradiance=[e * (1 + by) + dr.zeros(mi.Float, n) for e in far.irradiance]
        )

    near = replace(case.pixels, nearer=Nearer(0.5, tuple(light(by) for by in (-0.5, 0, 0.5))))
    assert case.pixels.signals(theta, case.told).shape[1] == 4
    signals = near.signals(theta, case.told)
    high, low = (near.signals(theta, replace(case.told, distance=by))[:, 0] for by in (0.02, -0.02))
    np.testing.assert_allclose(signals[:, 4], (high - low) / 0.04, atol=2e-3 * np.abs(signals[:, 4]).max())
    assert np.abs(signals[:, 4]).max() > 0.3 * signals[:, 0].max()


def test_the_speed_of_light_is_that_which_events_see(case):
    """Of log I, of all LEDs in turn: the mean over slots, each as often as it has events."""
    theta = case.solution.theta[case.row].astype(float)
    light = np.log(case.pixels.signals(theta, case.told)[:, 0] + C_W)
    change = np.abs(light - np.roll(light, -1, axis=1))
    expected = np.average(change, weights=change)
    assert case.pixels.speed(theta, case.told) == pytest.approx(expected, rel=1e-5)
