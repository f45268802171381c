"""The information of events: against the scores of a likelihood by another hand, in float64."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import log_ndtr

from evsdr.events.pixel import EventPixel
from evsdr.events.simulator import draw_pattern, find_crossings
from evsdr.limits.information import _of_block, average_information
from evsdr.solve.law import SLOWEST
from evsdr.solve.shared.rig import N_TIMING
from tests.support.analytic import ring_directions
from tests.support.plans import PIXEL, SCHEDULE, many, plan_of
from tests.support.sphere import C_W, SPECTRUM

BAND, N_SLOT = np.arange(24) % 8, 24
N_OWN = 12  # slopes, log reflectances, log thresholds; after these the log powers of all LEDs, and the refractory period
BRIEF = 0.005  # refractory period [slots]


class Recordings:
    """Many recordings of one pixel, and the logarithm of their likelihood in plain NumPy.

    Between two events the next ON and the next OFF threshold compete: the density of the one that was met, and the
    probability that the other was not met before. Light that changes by less than SLOWEST thresholds a slot counts as if by
    nearly that, as everywhere: by light that hardly changes scores are without bounds.
    """

    def __init__(self, plan, n: int):
        self.plan, self.noise, self.n = plan, plan.pixel.event_noise, n
        slope = -plan.normal[0, 0, :2] / plan.normal[0, 0, 2]
        truth = (
            np.log(SPECTRUM),
            np.log([plan.pixel.contrast_threshold_on, plan.pixel.contrast_threshold_off]),
        )
        self.truth = np.concatenate([slope, *truth, np.zeros(24), [BRIEF]])
        signal = np.repeat((np.exp(self.nodes(self.truth)) - C_W)[:, None, None], n, axis=2)
        pattern = draw_pattern(plan.pixel, 1, n, 5)
        found = find_crossings(signal, C_W, plan.schedule, plan.n_round, plan.pixel, pattern)
        order = np.argsort(found.pixel, kind="stable")
        t = found.t_us[order] / plan.schedule.slot_us
        follows = np.diff(found.pixel[order]) == 0
        self.number = found.pixel[order][1:][follows]
        self.before, self.end = t[:-1][follows], t[1:][follows]
        self.polarity = found.polarity[order][1:][follows].astype(float)
        self.last = t[np.append(~(np.diff(found.pixel[order]) == 0), True)]

    def nodes(self, unknown):
        """Give log I where slots start (24,)."""
        p, q = unknown[:2]
        normal = np.array([-p, -q, 1]) / np.sqrt(1 + p * p + q * q)
        lit = np.maximum(ring_directions() @ normal, 0) * np.exp(unknown[2:10][BAND] + unknown[12:36])
        return np.log(lit + C_W)

    def log_likelihood(self, unknown):
        """Sum over the events of each recording, given the first (n,)."""
        nodes, log_c, refractory = self.nodes(unknown), unknown[10:12], unknown[36]
        light = np.exp(nodes)

        def log_light(t):
            slot = np.floor(t).astype(int)
            now, then = light[slot % N_SLOT], light[(slot + 1) % N_SLOT]
            value = now + (t - slot) * (then - now)
            return np.log(value), (then - now) / value

        def log_unmet(start, end, reference, side, threshold):
            far, first = np.zeros(len(start)), np.floor(start).astype(int)
            n_passed = np.minimum(np.floor(end).astype(int) - first, N_SLOT)
            for step in range(1, n_passed.max(initial=0) + 1):
                here = side * (nodes[(first + step) % N_SLOT] - reference)
                far = np.where(step <= n_passed, np.maximum(far, here), far)
            return log_ndtr((1 - far / threshold) / self.noise)

        p, start = self.polarity, self.before + refractory
        mine, other = (np.exp(np.where(q > 0, *log_c)) for q in (p, -p))
        (now, speed), (reference, _) = log_light(self.end), log_light(start)
        z = (p * (now - reference) / mine - 1) / self.noise
        value = -0.5 * z**2 - np.log(mine) + np.log(p * speed + np.hypot(speed, SLOWEST * mine))
        value += log_unmet(start, self.end, reference, -p, other)
        total = np.bincount(self.number, value, self.n)
        start, stop = self.last + refractory, np.full(self.n, float(self.plan.n_round * N_SLOT))
        for side, log_threshold in zip((1.0, -1.0), log_c):
            total += log_unmet(start, stop, log_light(start)[0], side, np.exp(log_threshold))
        return total

    def scores(self, which):
        """Differentiate by some unknowns (n, n_which)."""
        step = 1e-6 * np.eye(len(self.truth))
        values = [
            (self.log_likelihood(self.truth + h), self.log_likelihood(self.truth - h)) for h in step[which]
        ]
        return np.array([(up - down) / 2e-6 for up, down in values]).T


def pixel(noise: float, **options) -> EventPixel:
    """Give a pixel whose thresholds are unknown, but spread by next to nothing."""
    ideal = EventPixel(
        0.3, 0.4, event_noise=noise, refractory_us=BRIEF * SCHEDULE.slot_us, **options
    ).idealised()
    return replace(ideal, spread_on=1e-9, spread_off=1e-9)


@pytest.mark.parametrize(
    "noise, normal, smooth",
    [(0.1, [0.3, 0.2, 1], True), (0.2, [0.3, 0.2, 1], True), (0.1, [-0.8, 0.1, 1], False)],
)
def test_scores_scatter_as_the_information_says(noise, normal, smooth):
    """And vanish on average, but for light that comes back to earlier extremes: the edges that are left out."""
    n = 2000
    which = np.append(np.arange(N_OWN), [N_OWN + 3, N_OWN + 12, 36])
    plan = plan_of(many(normal, n), pixel=pixel(noise))
    score = Recordings(plan, n).scores(which)
    information = average_information(plan_of(many(normal, 64), pixel=pixel(noise)), repeats=8)
    shared = [3, 12, 24 + 4]  # of the columns of a rig
    own, cross = information.own.mean(axis=0), information.cross.mean(axis=0)[:, shared]
    expected = np.block([[own, cross], [cross.T, information.shared[np.ix_(shared, shared)] / 64]])
    size = np.sqrt(np.diag(expected))
    z = np.sqrt(n) * score.mean(axis=0) / size
    assert np.abs(z).max() < 4.5 if smooth else np.abs(z).max() > 8
    # as eigenvalues of n samples scatter (Marchenko and Pastur 1967), and 4 % for what the information's own mean does
    found = np.linalg.eigvals(np.linalg.solve(expected, np.cov(score.T))).real
    room = 2 * np.sqrt(len(which) / n) + 0.04
    assert 1 - room < found.min() and found.max() < 1 + room


def test_a_mean_over_recordings_does_not_hang_on_them():
    plan = plan_of(many([0.3, 0.2, 1], 200))
    first, second = (average_information(plan, 6, seed).own for seed in (0, 1))
    one = average_information(plan, 1, 2).own
    mean = first.mean(axis=0)
    size = np.sqrt(np.diag(mean))
    np.testing.assert_allclose(
        second.mean(axis=0) / np.outer(size, size), mean / np.outer(size, size), atol=0.02
    )
    apart, rough = (np.std(v[:, 0, 0]) / v[:, 0, 0].mean() for v in (first, one))
    assert rough == pytest.approx(np.sqrt(6) * apart, rel=0.25) and apart < 0.1


def test_pixels_do_not_depend_on_their_block(monkeypatch):
    normal = np.concatenate([many([0.3, 0.2, 1], 5), many([-0.2, 0.5, 1], 5)], axis=1)
    mask = np.arange(10)[None] != 3
    whole = average_information(plan_of(normal, mask), 30)
    monkeypatch.setattr("evsdr.limits.information.BYTES", 4 * 8 * 100**2)  # 94 unknowns: four pixels
    parts = average_information(plan_of(normal, mask), 30)
    assert whole.own.shape == parts.own.shape == (9, 10, 10) and whole.cross.shape == (
        9,
        10,
        3 * 24 + N_TIMING,
    )
    for name in ("n_pair", "own", "cross", "shared"):
        found, expected = getattr(parts, name), getattr(whole, name)
        np.testing.assert_allclose(
            found, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max(), err_msg=name
        )


def test_what_is_kept_of_a_block_holds_no_more_of_it():
    """All of it takes 70 to 200 KB a pixel: of an object of 256 x 256 pixels under 48 LEDs 13 GB."""
    plan, number = plan_of(many([0.3, 0.2, 1], 3)), np.arange(3)
    kept = _of_block(plan, draw_pattern(PIXEL, 1, 3, 0), number, np.zeros((1, 3), np.uint64), False)
    assert all(values.base is None for values in kept)


def test_directions_are_looked_at_if_asked_for():
    plan = plan_of(many([0.3, 0.2, 1], 8))
    without, with_them = (average_information(plan, tilted=tilted) for tilted in (False, True))
    assert (
        not without.shared[24 + N_TIMING :].any() and (np.diag(with_them.shared)[24 + N_TIMING :] > 0).all()
    )
    np.testing.assert_array_equal(
        *(of.shared[: 24 + N_TIMING, : 24 + N_TIMING] for of in (without, with_them))
    )


def test_what_pixels_share_is_that_of_the_sensor():
    """The lag of an EVK4 is 53 us, its noise 0.01 behind the photoreceptor; an ideal pixel has neither."""
    evk4, ideal = (plan_of(many([0.3, 0.2, 1], 1), pixel=p) for p in (EventPixel(), PIXEL))
    assert evk4.rig.tau * SCHEDULE.slot_us == pytest.approx(53, abs=0.1)
    assert evk4.rig.noise == pytest.approx(0.01, rel=0.05)
    assert evk4.rig.refractory * SCHEDULE.slot_us == pytest.approx(52)
    np.testing.assert_allclose(evk4.spread, [0.049 / 0.2525, 0.039 / 0.3795])
    assert ideal.rig.tau == ideal.rig.noise == 0 and not ideal.spread.any()


def test_noise_of_photoreceptors_takes_information():
    sensors = (EventPixel(photon_rate_per_us=rate, leak_hz=0.0) for rate in (100.0, 10.0))
    quiet, loud = (average_information(plan_of(many([0.3, 0.2, 1], 64), pixel=s)) for s in sensors)
    assert quiet.own.shape[1:] == (N_OWN, N_OWN)
    size = [np.linalg.det(info.own.mean(axis=0)) for info in (quiet, loud)]
    assert size[1] < 0.01 * size[0]
