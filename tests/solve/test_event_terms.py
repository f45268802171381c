"""Normal equations of pairs against a plain loop."""

from dataclasses import replace

import mitsuba as mi
import numpy as np
import pytest

from evsdr.solve.event_terms import normal_equations
from evsdr.solve.law import SLOWEST
from tests.support.random_pairs import C_W, N_BAND, N_PIXEL, ORDER, ROBUST, SCALE, N, Scene, derivative


@pytest.fixture
def scene(rng):
    return Scene.draw(rng)


def rarity(scene, i, k, theta, share):
    """-log p_k df/dt / C of a pair."""
    polarity, slot = scene.polarity[k], int(scene.end[k]) % len(ORDER)
    total, lit = scene.light(i, scene.end[k], theta, share)
    speed = polarity * (lit[ORDER[(slot + 1) % len(ORDER)]] - lit[ORDER[slot]]) / total
    speed /= scene.threshold(i, polarity, theta)
    return -np.log(0.5 * (speed + np.hypot(speed, SLOWEST)))


@pytest.mark.parametrize(
    ("thresholds", "share", "answered"),
    [(False, 0.0, False), (True, 0.0, False), (False, 0.7, True), (True, 0.7, False), (True, 0.0, True)],
)
def test_terms_are_those_of_a_plain_loop(scene, rng, thresholds, share, answered):
    """Weights of pairs, a share of the signal that no reflectance scales, and log light that counts more or less than once."""
    n = N if thresholds else 2 + N_BAND
    answer = rng.uniform(0.3, 2.0, (len(scene.start), 2)).astype(np.float32) if answered else None
    pairs = replace(scene.pairs, weight=mi.Float(scene.weight))
    if answered:
        pairs = replace(pairs, answer=mi.Float(answer.ravel()))
    given = mi.Float(C_W), N_BAND, mi.Float(SCALE), mi.Float(ROBUST), thresholds, share
    cost, gradient, matrix = normal_equations(scene.table(scene.share * scene.signal), pairs, *given)
    full, n_event = np.zeros(N), 0
    for i in range(N_PIXEL):
        expected = [0.0, np.zeros(n), np.zeros((n, n))]
        for k in range(scene.offset[i], scene.offset[i + 1]):

            def r(theta, i=i, k=k):
                change = scene.change(i, scene.start[k], scene.end[k], theta, scene.share) + scene.bias[k]
                if answered:
                    ends = scene.start[k], scene.end[k]
                    logs = np.log([scene.light(i, phase, theta, scene.share)[0] for phase in ends])
                    change += (answer[k] - 1) @ (logs * [-1, 1])
                polarity = scene.polarity[k]
                return (polarity * change / scene.threshold(i, polarity, theta) - 1) / SCALE

            here, jacobian = r(full), derivative(r)[:n]
            excess = (here / ROBUST) ** 2
            value, weight = 0.5 * ROBUST**2 * np.log1p(excess), 1 / (1 + excess)
            parts = [value, weight * here * jacobian, weight * np.outer(jacobian, jacobian)]
            if share and np.float32(1 + scene.end[k]) % 1 > 0:  # while LEDs fade
                rare = rarity(scene, i, k, full, scene.share)
                slope = derivative(lambda theta, i=i, k=k: rarity(scene, i, k, theta, scene.share))[:n]
                more = share * rare, share * slope, share * np.outer(slope, slope)
                parts = [a + b for a, b in zip(parts, more)]
            expected = [a + scene.weight[k] * b for a, b in zip(expected, parts)]
            n_event += 1
        np.testing.assert_allclose(cost.numpy()[i], expected[0], rtol=1e-3, atol=1e-3)
        np.testing.assert_allclose([g.numpy()[i] for g in gradient], expected[1], rtol=5e-3, atol=1e-2)
        triangle = expected[2][np.tril_indices(n)]
        found = np.array([m.numpy()[i] for m in matrix])
        np.testing.assert_allclose(found, triangle, rtol=5e-3, atol=2e-3 * np.abs(triangle).max() + 1e-6)
    assert n_event > 40


def test_nothing_is_gained_where_contrasts_and_thresholds_shrink_together(scene):
    """Else thresholds of a surface that is not matt, in bright constant light, would go to zero."""
    veil, costs = mi.Float(1e3), []
    for factor in (1.0, 0.1):
        small = replace(scene, **{name: factor * getattr(scene, name) for name in ("signal", "by_p", "by_q")})
        pairs = replace(
            scene.pairs,
            bias=None,
            threshold_on=mi.Float(1e-3 * factor * scene.on),
            threshold_off=mi.Float(1e-3 * factor * scene.off),
        )
        given = veil, N_BAND, mi.Float(SCALE), mi.Float(ROBUST), True, 0.7
        costs.append(normal_equations(small.table(), pairs, *given)[0].numpy())
    np.testing.assert_allclose(*costs, rtol=0.02, atol=0.02)
