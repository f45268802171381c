"""The kernel of shared unknowns: derivatives by finite differences, the law of the maps' solver, and real events."""

from dataclasses import dataclass, replace

import mitsuba as mi
import numpy as np
import pytest

from evsdr.events.lead import TABLE
from evsdr.events.pairs import pair_events
from evsdr.events.phase import position
from evsdr.events.pixel import EventPixel
from evsdr.events.simulator import simulate_events
from evsdr.records import Recording, Sensor
from evsdr.solve import silence_terms
from evsdr.solve.event_terms import normal_equations
from evsdr.solve.law import SLOWEST, gaussian_share
from evsdr.solve.loss import derivative_table
from evsdr.solve.pair_data import PairData, bounds, pack_phases, pack_slots
from evsdr.solve.shared.kernel import DISTANCE, N_TIMING, OFF, ON, Terms, pixel_sums
from tests.support.pixel_light import ring
from tests.support.sphere import NO_FLAWS

N_LED, N_PIXEL, VEIL, FAST = 6, 5, 0.05, 1e-6
ROBUST, SHARE = 3.0, gaussian_share(3.0)
ORDER = np.array([0, 1, 6, 2, 5, 4, 3, 3])  # LED 6 is darkness
BAND = np.arange(N_LED) % 3
N_MAP, N_EVENT = 5, 40  # unknowns of the maps; events of a pixel
STEPS = np.array([1e-7, 1e-4, 1e-5, 1e-6, 1e-6, 1e-6, 1e-2])
TIMING = slice(0, 6)  # of the columns after those of the LEDs


@dataclass(frozen=True)
class Case:
    """Random pixels with events that may be anything."""

    signals: np.ndarray
    tilts: np.ndarray
    thresholds: np.ndarray
    events: tuple
    values: np.ndarray
    own: bool = True
    crossfade: float = 1.0
    scatter: float = 0.3
    weigh: np.ndarray | None = None

    @classmethod
    def draw(cls, rng, tau=FAST, noise=0.0, longest=1.5, **options):
        gap = rng.uniform(0.3, longest, N_PIXEL * N_EVENT)
        gap[7::11] = 0.02  # within the refractory period: they tell nothing
        inside = rng.random(len(gap)) < 0.95
        events = (
            np.arange(0, N_PIXEL * N_EVENT + 1, N_EVENT),
            np.cumsum(gap) % len(ORDER),
            gap,
            rng.choice(np.array([-1, 1], np.int8), len(gap)),
            inside,
            rng.uniform(0.5, 12, N_PIXEL),
        )
        signals = rng.uniform(0.2, 1, (N_PIXEL, 4, N_LED))
        signals[:, 1:3] -= 0.6
        by_distance = np.random.default_rng(1).uniform(-0.4, 0.4, (N_PIXEL, 1, N_LED))
        signals = np.concatenate([signals, by_distance], axis=1)
        values = np.array([tau, 0.02, noise, 0.013, 0.05, 0.04, 0.1])
        tilts = rng.normal(0, 0.5, (N_PIXEL, N_LED, 2))
        thresholds = rng.uniform(0.2, 0.8, (N_PIXEL, 2))
        return cls(signals, tilts, thresholds, events, values, **options)

    def sums(self, move=None, some=None):
        """Evaluate at unknowns moved by (n + m,), those of maps in all pixels alike; or only some pixels."""
        move = np.zeros(self.width) if move is None else move
        n = self.n
        maps, shared = move[:N_MAP], move[n:]
        power, timing, tilt = np.split(shared, [N_LED, N_LED + N_TIMING])
        logs = move[N_MAP:n] if self.own else timing[7:9]
        signals = self.signals.copy()
        signals[:, 0] += signals[:, 1] * maps[0] + signals[:, 2] * maps[1]
        signals[:, 0] += signals[:, 3] * np.expm1(maps[2:][BAND])
        signals[:, 0] += signals[:, 4] * timing[9] if len(signals[0]) > 4 else 0.0
        signals[:, 0] *= np.exp(power + np.einsum("ijk,jk->ij", self.tilts, tilt.reshape(N_LED, 2)))
        values = np.tile(self.values + timing[:7], (5, 1))
        values[[1, 2, 3, 4], [0, 1, 2, 6]] += STEPS[[0, 1, 2, 6]]
        weigh = np.zeros(len(self.events[1])) if self.weigh is None else self.weigh
        return pixel_sums(
            self.events, ORDER, BAND, VEIL, signals, self.tilts, self.thresholds * np.exp(logs), self.own,
            values, Terms(self.crossfade, self.scatter, ROBUST, SHARE), TABLE, weigh, some,
        )  # fmt: skip

    @property
    def n(self):
        return N_MAP + 2 * self.own

    @property
    def width(self):
        return self.n + N_LED * 3 + N_TIMING

    def by_steps(self, value, steps):
        """Differentiate value(sums) by every unknown."""
        return np.array(
            [
                (value(self.sums(h * e)) - value(self.sums(-h * e))) / (2 * h)
                for e, h in zip(np.eye(self.width), steps)
            ]
        )

    @property
    def steps(self):
        steps = np.full(self.width, 1e-6)
        first = self.n + N_LED
        steps[first : first + 7] = STEPS / 2
        return steps


def everything_but_timing(case):
    return np.delete(np.arange(case.width), case.n + N_LED + np.arange(6))


def gradient(sums):
    return sums[1].sum(axis=0)


@pytest.mark.parametrize("crossfade", [1.0, 0.4])
@pytest.mark.parametrize("own", [True, False])
def test_the_gradient_is_that_of_the_cost(rng, own, crossfade):
    """By maps, powers, thresholds and directions; without a lag, of which derivatives are those to first order."""
    case = Case.draw(rng, own=own, crossfade=crossfade)
    sums, expected = case.sums(), case.by_steps(lambda s: s[0].sum(), case.steps)
    which = everything_but_timing(case)
    if own:
        assert not gradient(sums)[case.n + N_LED + 6 :][:3].any()
    np.testing.assert_allclose(gradient(sums)[which], expected[which], atol=0.01 * np.abs(expected).max())
    assert np.isfinite(sums[3]).sum() > 100 and np.isnan(sums[3]).sum() > 15
    assert np.median(np.abs(expected[which])) > 10


@pytest.mark.parametrize("own", [True, False])
def test_the_gradient_by_distance_is_that_of_the_cost(rng, own):
    """Of light that changes with it, each LED's and each pixel's in its own way; of light without that row there is none."""
    case = Case.draw(rng, own=own)
    column, step = case.n + N_LED + DISTANCE, 1e-6
    expected = [case.sums(s * step * np.eye(case.width)[column])[0].sum() for s in (1, -1)]
    found = gradient(case.sums())[column]
    assert found == pytest.approx((expected[0] - expected[1]) / (2 * step), rel=1e-3) and abs(found) > 10
    assert gradient(replace(case, signals=case.signals[:, :4]).sums(np.zeros(case.width)))[column] == 0


def test_nothing_is_gained_by_contrasts_that_shrink_with_thresholds(rng):
    """Where LEDs hardly show beside constant light, log I is in proportion to their light; a leak shrinks, too."""
    case = Case.draw(rng)
    leak = np.array([0, 0, 0, 0, 0, 1, 0], bool)

    def shrunk(by):
        signals, values = case.signals * by, np.where(leak, by * case.values, case.values)
        return replace(case, signals=signals, thresholds=case.thresholds * by, values=values).sums()[0]

    np.testing.assert_allclose(shrunk(1e-6), shrunk(1e-4), rtol=1e-3)


def test_some_pixels_are_as_among_all(rng):
    case, some = Case.draw(rng), np.array([1, 4])
    whole, part = case.sums(), case.sums(some=some)
    offset = case.events[0]
    for i, (a, b) in enumerate(zip(whole, part)):
        of_pixels = i < 3
        chosen = some if of_pixels else np.concatenate([np.arange(offset[k], offset[k + 1]) for k in some])
        np.testing.assert_array_equal(a[chosen], b[chosen])
        rest = np.delete(b, chosen, axis=0)
        assert np.all(rest == 0) if i != 3 else np.isnan(rest).all()


def test_each_pixel_has_its_own_gradient(rng):
    case = Case.draw(rng)
    found, steps = case.sums()[1], case.steps
    for i in range(case.n):
        expected = [case.sums(s * steps[i] * np.eye(case.width)[i])[0] for s in (1, -1)]
        expected = (expected[0] - expected[1]) / (2 * steps[i])
        np.testing.assert_allclose(found[:, i], expected, atol=0.01 * np.abs(expected).max())


@pytest.mark.parametrize("tau", [FAST, 0.02])
def test_the_gradient_by_timing_is_that_of_residuals_and_silence(rng, tau):
    """The density of times has none, on purpose: the difference of two scatters is free of it."""
    case = Case.draw(rng, tau=tau, weigh=np.full(N_PIXEL * N_EVENT, 0.01))
    cases = case, replace(case, scatter=0.6)
    found = np.subtract(*(gradient(c.sums()) for c in cases))
    expected = np.subtract(*(c.by_steps(lambda s: s[0].sum(), c.steps) for c in cases))
    first = case.n + N_LED
    for k, name in enumerate(("tau", "dark", "noise", "shift", "refractory", "leak")):
        if name == "noise" or (name == "dark" and tau == FAST):
            continue  # noise can only grow from 0; without a lag a dark current does nothing
        assert abs(expected[first + k]) > 0.5
        assert found[first + k] == pytest.approx(expected[first + k], rel=0.02), name


@pytest.fixture
def loud(rng):
    """Every second event follows the one before it within a slot, so that no silence counts; the others tell nothing."""
    case = Case.draw(rng, tau=0.02, noise=0.03, own=False, weigh=np.full(N_PIXEL * N_EVENT, 0.01))
    offset, _, gap, polarity, *_ = case.events
    at = np.arange(len(gap)) // 2 % len(ORDER) + np.tile((0.0, 0.3), len(gap) // 2)
    at += np.repeat(rng.uniform(0.2, 0.65, len(gap) // 2), 2)
    inside = np.arange(len(gap)) % 2 == 1
    return replace(case, events=(offset, at, np.full(len(gap), 0.3), polarity, inside, np.zeros(N_PIXEL)))


def test_the_gradient_by_noise_is_that_of_residuals(loud):
    """What noise adds to the variance is held fixed, the density of times left out, and what a shift does to the lead."""
    cases = loud, replace(loud, scatter=0.6)
    found = np.subtract(*(gradient(c.sums()) for c in cases))
    expected = np.subtract(*(c.by_steps(lambda s: s[0].sum(), c.steps) for c in cases))
    assert np.isfinite(loud.sums()[3]).sum() == N_PIXEL * N_EVENT / 2
    first = loud.n + N_LED
    largest = np.abs(expected[first:][TIMING]).max()
    np.testing.assert_allclose(
        found[first:][TIMING], expected[first:][TIMING], rtol=0.02, atol=1e-3 * largest
    )


def test_the_information_of_thresholds_by_hand(loud):
    """Each pair tells one by (u + 1) / scale, weighed by its law, and its time once more, the less the slower light changes."""
    still = replace(loud, values=loud.values * [1, 1, 0, 1, 1, 1, 1])  # without noise u changes as v does
    offset, at, *rest = still.events
    sums, later = still.sums(), replace(still, events=(offset, at + 1e-6 * rest[2], *rest)).sums()
    u, polarity, scale = sums[3], rest[1], np.sqrt(still.scatter**2 + 0.01)
    speed = (later[3] - u) / 1e-6 + polarity * still.values[5] / threshold_of(still)  # in thresholds a slot
    fast = speed / np.hypot(speed, SLOWEST)
    for column, p in ((still.n + N_LED + ON, 1), (still.n + N_LED + OFF, -1)):
        some = np.isfinite(u) & (polarity == p)
        weight = 1 / (1 + (u[some] / scale / ROBUST) ** 2)
        expected = np.sum(weight * ((u[some] + 1) / scale) ** 2 + SHARE * fast[some] ** 2)
        assert sums[2][:, column, column].sum() == pytest.approx(expected, rel=1e-4)
    assert np.abs(fast[np.isfinite(u)]).min() < 0.8


def threshold_of(case):
    """Give the threshold that each event met."""
    return case.thresholds[np.repeat(np.arange(N_PIXEL), N_EVENT), (case.events[3] < 0).astype(int)]


def test_the_variance_of_a_residual_is_that_of_both_ends(loud):
    """Far beyond the time constant the reference is noise at rest; the lead scatters less."""
    apart = replace(loud, values=loud.values + [0, 0, 0, 0, 0.2, 0, 0])
    variance, u = apart.sums()[4], apart.sums()[3]
    relative = (variance * threshold_of(apart) ** 2 / 0.03**2)[np.isfinite(u)]
    assert 1.2 < np.median(relative) < 2 and relative.max() < 2.01 and relative.min() > 1


def test_with_a_lag_derivatives_hold_to_first_order(rng):
    """They stand at the light that is shown; the difference of two scatters is that of residuals and silence."""
    case = Case.draw(rng, tau=0.01)
    cases = case, replace(case, scatter=0.6)
    found = np.subtract(*(gradient(c.sums()) for c in cases))
    expected = np.subtract(*(c.by_steps(lambda s: s[0].sum(), c.steps) for c in cases))
    which = everything_but_timing(case)
    np.testing.assert_allclose(found[which], expected[which], atol=0.03 * np.abs(expected[which]).max())


@pytest.mark.parametrize("tau", [0.01, 0.3])
def test_however_large_a_lag_the_derivative_by_all_light_is_right(rng, monkeypatch, tau):
    """Of powers together, without other light: the shown light has one answer, whatever LEDs it comes from."""
    monkeypatch.setattr("tests.solve.shared.test_kernel.VEIL", 1e-9)
    monkeypatch.setattr("tests.solve.shared.test_kernel.ORDER", np.array([0, 1, 3, 2, 5, 4, 3, 3]))
    case = Case.draw(rng, tau=tau)
    case.values[1] = 1e-9  # no dark current
    all_powers = np.zeros(case.width)
    all_powers[case.n : case.n + N_LED] = 1

    def cost(step):
        sharp, blunt = (replace(case, scatter=s).sums(step * all_powers)[0].sum() for s in (0.3, 0.6))
        return sharp - blunt

    found = np.subtract(*(gradient(replace(case, scatter=s).sums()) @ all_powers for s in (0.3, 0.6)))
    assert found == pytest.approx((cost(1e-6) - cost(-1e-6)) / 2e-6, rel=0.02)


def test_the_information_is_a_symmetric_one(rng):
    case = Case.draw(rng, own=False, tau=0.01, noise=0.01)
    matrix = case.sums()[2]
    np.testing.assert_allclose(matrix, matrix.swapaxes(1, 2))
    assert (np.linalg.eigvalsh(matrix) > -1e-9 * np.abs(matrix).max()).all()


@pytest.mark.parametrize("tau, crossfade", [(0.0, 1.0), (0.0, 0.3), (0.004, 1.0), (0.004, 0.3), (0.03, 1.0)])
def test_events_without_noise_leave_no_residual(rng, tau, crossfade):
    """Simulated behind photoreceptors, times exact to 1e-6 slots: at the truth each pair gives its threshold."""
    slot_us, leak = 1e6, 0.1
    flaws = {"cutoff_hz": 1e6 / (2 * np.pi * tau * slot_us) if tau else 0.0, "leak_hz": leak / 0.2}
    pixel = EventPixel(0.2, 0.3, event_noise=0.0, refractory_us=0.05 * slot_us, **NO_FLAWS | flaws)
    schedule = ring(range(N_LED), slot_us, crossfade)
    signal = rng.uniform(0.05, 1, (N_LED, 2, 3))
    events, on, off, starts = simulate_events(signal, VEIL, schedule, 4, pixel)
    number = events.y * 3 + events.x
    order = np.argsort(number, kind="stable")
    t = events.t[order]
    at, inside = position(t, schedule, starts)
    offset = np.append(0, np.cumsum(np.bincount(number, minlength=6)))
    gap = np.diff(t, prepend=t[:1]) / slot_us
    polarity = (2 * events.p[order] - 1).astype(np.int8)
    given = offset, at, gap, polarity, inside, np.zeros(6)
    table = np.zeros((6, 4, N_LED))
    table[:, 0] = signal.reshape(N_LED, 6).T

    def residual(*truth):
        values = np.tile(np.maximum([*truth, 0], [FAST, 0, 0, -1, 0, 0, 0]), (5, 1))
        thresholds = np.stack([on.ravel(), off.ravel()], axis=-1).astype(float)
        terms = Terms(crossfade, 0.01, ROBUST, SHARE)
        given_light = np.arange(N_LED), np.arange(N_LED) % 3, VEIL, table, np.zeros((6, N_LED, 0)), thresholds
        out = pixel_sums(given, *given_light, False, values, terms, TABLE, np.zeros(len(t)))
        return out[3][np.isfinite(out[3])]

    right = residual(tau, 0, 0, 0, 0.05, leak)
    assert len(right) > 100 and np.median(np.abs(right)) < 3e-4 and np.quantile(np.abs(right), 0.95) < 0.01
    for wrong in ((tau + 0.01, 0, 0, 0, 0.05), (tau, 0, 0, 0.01, 0.05), (tau, 0, 0, 0, 0.06)):
        assert np.median(np.abs(residual(*wrong, leak))) > 0.01
    assert np.median(np.abs(residual(tau, 0, 0, 0, 0.05, 0.0))) > 0.01
    if tau:
        assert np.median(np.abs(residual(tau, 0.2, 0, 0, 0.05, leak))) > 0.002


def test_the_law_is_that_of_the_maps_solver(rng, monkeypatch):
    """Without lag and noise both count the same: pairs, the density of their times, and silence.

    Only the solver of the maps minds that the threshold that was met was not met before: nothing once times are exact.
    """
    monkeypatch.setattr(silence_terms, "JITTER", 1e-6)
    slot_us, refractory = 1e6, 0.05
    order = np.where(ORDER < N_LED, ORDER, -1).astype(np.int32)
    schedule = ring(order, slot_us, 1.0)
    signal = rng.uniform(0.05, 1, (N_LED, 1, N_PIXEL))
    pixel = EventPixel(0.4, 0.5, event_noise=0.1, refractory_us=refractory * slot_us, **NO_FLAWS)
    events, on, off, starts = simulate_events(signal, VEIL, schedule, 3, pixel)
    recording = Recording(events, Sensor(N_PIXEL, 1, on, off, refractory * slot_us), schedule, starts)
    pairs = pair_events(recording)
    by_p, by_q = rng.normal(0, 0.3, (2, N_LED, N_PIXEL))
    lit = signal[:, 0]
    theirs = PairData(
        **dict(zip(("first", "last"), bounds(pairs.offset, mi.UInt32))),
        phases=mi.Float(pack_phases(pairs.phase_start, pairs.phase_end, pairs.polarity)),
        threshold_on=mi.Float(on.ravel()),
        threshold_off=mi.Float(off.ravel()),
        slot_leds=mi.UInt32(pack_slots(order, N_LED)),
        **dict(zip(("silent_first", "silent_last"), bounds(pairs.silent_offset, mi.UInt32))),
        silent_phases=mi.Float(pack_phases(pairs.silent_start, pairs.silent_end, pairs.silent_polarity)),
        silent_probes=mi.UInt32(np.stack([pairs.probe_offset[:-1], pairs.probe_offset[1:]], -1).ravel()),
        probes=mi.Float(pairs.silent_probe),
    )
    rows = [[mi.Float(row) for row in part.astype(np.float32)] for part in (lit, by_p, by_q)]
    scale = 0.1
    given = derivative_table(*rows, BAND.tolist(), N_PIXEL), theirs, mi.Float(VEIL), 3, mi.Float(scale)
    told = normal_equations(*given, ROBUST, True, SHARE), silence_terms.silence_equations(*given, True)
    cost = sum(part[0].numpy() for part in told)
    slope = sum(np.array([g.numpy() for g in part[1]]) for part in told)
    cost += np.diff(pairs.offset) * np.log(scale)

    number = events.x.astype(int)
    sort = np.argsort(number, kind="stable")
    t, offset = events.t[sort], np.append(0, np.cumsum(np.bincount(number, minlength=N_PIXEL)))
    at, inside = position(t, schedule, starts)
    ending = (starts[-1] - t[offset[1:] - 1]) / slot_us
    gap = np.diff(t, prepend=t[:1]) / slot_us
    ours = offset, at, gap, (2 * events.p[sort] - 1).astype(np.int8), inside, ending
    values = np.tile([FAST, 0, 0, 0, refractory, 0.0, 0.0], (5, 1))
    table = np.stack([lit, by_p, by_q, lit]).transpose(2, 0, 1).copy()
    thresholds = np.stack([on.ravel(), off.ravel()], axis=-1).astype(float)
    found = pixel_sums(
        ours, ORDER, BAND, VEIL, table, np.zeros((N_PIXEL, N_LED, 0)), thresholds, True, values,
        Terms(1.0, scale, ROBUST, SHARE), TABLE, np.zeros(len(t)),
    )  # fmt: skip
    assert len(pairs.silent_start) > 20
    # between nodes a parabola stands for log I: its slope is off by up to a half percent
    np.testing.assert_allclose(found[0], cost, atol=0.006 * np.diff(pairs.offset).max())
    np.testing.assert_allclose(found[1][:, :7].T, slope, atol=0.01 * np.abs(slope).max())
