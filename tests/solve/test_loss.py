"""Residuals of pairs, and the likelihood of first passage: its probabilities, its scores, its information."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from evsdr.events.pairs import pair_events
from evsdr.model.lambert import LambertianRing
from evsdr.solve import law, silence_terms
from evsdr.solve.event_terms import normal_equations
from evsdr.solve.loss import derivative_table, relative_residual
from evsdr.solve.pair_data import signal_table
from evsdr.solve.problem import make_problem
from evsdr.solve.silence_terms import silence_equations
from evsdr.solve.unknowns import to_theta
from tests.support import sphere
from tests.support.analytic import lambert_signals, ring_directions
from tests.support.passage import Pixel
from tests.support.random_pairs import BAND, C_W, N_BAND, N_PIXEL, ROBUST, SCALE, Scene


@pytest.fixture
def scene(rng):
    return Scene.draw(rng)


def test_residuals_are_those_of_a_plain_loop(scene):
    table = signal_table([mi.Float(row) for row in scene.signal], N_PIXEL)
    pixel = np.repeat(np.arange(N_PIXEL), np.diff(scene.offset))
    k = dr.arange(mi.UInt32, len(pixel))
    given = scene.pairs, mi.Float(C_W), k, mi.UInt32(pixel.astype(np.uint32)), True
    u, threshold = relative_residual(table, *given)
    told = np.where(scene.polarity > 0, scene.on[pixel], scene.off[pixel])
    change = [scene.change(i, *ends, np.zeros(7)) for i, *ends in zip(pixel, scene.start, scene.end)]
    np.testing.assert_allclose(
        u.numpy(), scene.polarity * (change + scene.bias) / told - 1, rtol=1e-4, atol=1e-4
    )
    np.testing.assert_allclose(threshold.numpy(), told)


def test_gradient_is_that_of_automatic_differentiation(scene):
    """The derivative by log reflectance of the Cauchy cost, through the differentiable residual."""
    given = mi.Float(C_W), N_BAND, mi.Float(SCALE), mi.Float(ROBUST)
    _, gradient, _ = normal_equations(scene.table(), scene.pairs, *given)
    log_gain = [dr.zeros(mi.Float, N_PIXEL) for _ in range(N_BAND)]
    dr.enable_grad(log_gain)
    table = signal_table([mi.Float(row) * dr.exp(log_gain[b]) for row, b in zip(scene.signal, BAND)], N_PIXEL)
    pixel = mi.UInt32(np.repeat(np.arange(N_PIXEL, dtype=np.uint32), np.diff(scene.offset)))
    k = dr.arange(mi.UInt32, scene.offset[-1])
    u, _ = relative_residual(table, scene.pairs, mi.Float(C_W), k, pixel, True)
    dr.backward(dr.sum(0.5 * ROBUST**2 * dr.log(1 + dr.square(u / (SCALE * ROBUST)))))
    for b in range(N_BAND):
        np.testing.assert_allclose(
            gradient[2 + b].numpy(), dr.grad(log_gain[b]).numpy(), rtol=1e-3, atol=1e-3
        )


# ---------------------------------------------------------------------- first passage


@pytest.mark.parametrize("noise", [0.1, 0.2])
def test_probabilities_sum_to_one(rng, noise):
    """An event of either polarity at some time, or silence; in float64, by another hand."""
    certain = []
    for _ in range(4):
        pixel = Pixel(rng.uniform(0.2, 0.5, 6), 0.3, 0.4, noise)
        start = rng.uniform(0, 6)
        edges = np.linspace(start, start + 3, 3001)
        middle, width = 0.5 * (edges[1:] + edges[:-1]), edges[1] - edges[0]
        silent = np.exp(pixel.log_silence(start, edges[-1]))
        fired = sum(np.exp(pixel.log_density(start, t, p)) for t in middle for p in (1, -1)) * width
        assert fired + silent == pytest.approx(1.0, abs=2e-3)
        certain.append(fired)
    assert max(certain) > 0.9 and min(certain) < 0.9


@pytest.mark.parametrize("noise", [0.1, 0.2])
def test_scores_vanish_at_the_truth_and_scatter_as_the_information_says(noise, monkeypatch):
    """Of simulated events, by all unknowns: thresholds too.

    Simulated thresholds are Gaussian and times exact, so that tails, jitter and the floor of the slope are left out.
    By steep slopes the matrix says too much: events just before an earlier extreme, which don't come.
    """
    monkeypatch.setattr(law, "SHARE", 1e-6)
    monkeypatch.setattr(silence_terms, "JITTER", 0.02)
    monkeypatch.setattr(law, "SLOWEST", 3e-3)
    n_same, n = 1500, 2 + 8 + 2
    few = np.array([[0.3, 0.2, 1], [-0.8, 0.1, 1], [0.5, -0.9, 1]])
    normal = np.repeat(few / np.linalg.norm(few, axis=1, keepdims=True), n_same, axis=0).reshape(3, n_same, 3)
    signal = lambert_signals(normal, np.broadcast_to(sphere.SPECTRUM, (3, n_same, 8)), ring_directions())
    recording = sphere.record_signal(signal, threshold=0.3, event_noise=noise, refractory_us=0.0)
    mask, light = np.ones((3, n_same), bool), sphere.ring_light()
    problem = make_problem(recording, pair_events(recording), light, mask)
    p, q, *rho = to_theta(normal[mask], np.tile(sphere.SPECTRUM, (3 * n_same, 1)), mi.Float)
    signals = LambertianRing(light)(p, q, [dr.exp(r) for r in rho], mi.Float(1e-5))
    table = derivative_table(*signals, light.band, 3 * n_same)
    given = table, problem.pairs, light.constant_light, 8, mi.Float(noise)
    events = normal_equations(*given, mi.Float(1e4), True, 1.0)  # Gaussian
    silences = silence_equations(*given, True)
    dr.eval(events, silences)  # else each is computed by a kernel of its own
    events, silences = (
        [np.array([v.numpy() for v in part]).T for part in terms[1:]] for terms in (events, silences)
    )
    rows, columns = np.tril_indices(n)
    for k in range(3):
        same = slice(k * n_same, (k + 1) * n_same)
        score = (events[0] + silences[0])[same]
        information = np.zeros((n, n))
        information[rows, columns] = (events[1] + silences[1])[same].mean(axis=0, dtype=float)
        information += np.tril(information, -1).T
        size = np.sqrt(np.diag(information))
        z, z_events = (np.sqrt(n_same) * v.mean(axis=0) / size for v in (score, events[0][same]))
        assert np.abs(z).max() < 4.5
        assert np.abs(z_events).max() > 8  # events alone are not all
        assert np.median(score.var(axis=0) / size**2) == pytest.approx(1, abs=0.15)
        assert np.allclose(score.var(axis=0)[-2:] / size[-2:] ** 2, 1, atol=0.1)  # thresholds
