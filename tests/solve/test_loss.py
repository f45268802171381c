from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from evsdr.solve.loss import (
    SILENT_MARGIN,
    SMALLEST_SLOPE,
    derivative_table,
    gaussian_share,
    normal_equations,
    relative_residual,
    silence_equations,
)
from evsdr.solve.pair_data import PairData, pack_phases, pack_slots, signal_table

N_LED, N_BAND, N_PIXEL, C_W, SCALE, ROBUST = 6, 3, 21, 0.1, 0.2, 3.0
ORDER = np.array([0, 1, -1, 2, 5, 4, 3, 3])
BAND = [j % N_BAND for j in range(N_LED)]


@pytest.fixture
def scene(rng):
    """Random signals, slope derivatives and pairs; some pixels have no pair."""
    signal = rng.uniform(0.05, 1, (N_LED, N_PIXEL)).astype(np.float32)
    by_p, by_q = rng.normal(0, 0.3, (2, N_LED, N_PIXEL)).astype(np.float32)
    count = rng.integers(0, 9, N_PIXEL)
    count[[0, 5]] = 0
    n = count.sum()
    start, end = rng.uniform(0, len(ORDER), (2, n)).astype(np.float32)
    end[3] = np.nextafter(np.float32(len(ORDER)), np.float32(0))  # 1 + end rounds up to 1 + n_slot
    start[7] = 2.0
    polarity = rng.choice([-1, 1], n)
    on, off = rng.uniform(0.1, 0.4, (2, N_PIXEL)).astype(np.float32)
    offset = np.append(0, np.cumsum(count))
    pairs = PairData(
        mi.UInt32(offset.astype(np.uint32)),
        mi.Float(pack_phases(start, end, polarity)),
        mi.Float(on),
        mi.Float(off),
        mi.UInt32(pack_slots(ORDER, N_LED)),
    )
    return signal, by_p, by_q, offset, start, end, polarity, on, off, pairs


def mixture(phase):
    """Shares of the LEDs (N_LED) lit at a phase."""
    slot, share = int(phase) % len(ORDER), np.zeros(N_LED)
    fade = phase - int(phase)
    for led, part in ((ORDER[slot], 1 - fade), (ORDER[(slot + 1) % len(ORDER)], fade)):
        if led >= 0:
            share[led] += part
    return share


def residual_and_jacobian(scene, i, k):
    """One pair in plain NumPy: u and its derivatives by p, q and log reflectances."""
    signal, by_p, by_q, _, start, end, polarity, on, off, _ = scene
    u, jacobian = 0.0, np.zeros(2 + N_BAND)
    for sign, phase in ((-1, start[k]), (1, end[k])):
        share = mixture(float(phase))
        intensity = share @ signal[:, i] + C_W
        u += sign * np.log(intensity)
        jacobian[0] += sign * (share @ by_p[:, i]) / intensity
        jacobian[1] += sign * (share @ by_q[:, i]) / intensity
        for j in range(N_LED):
            jacobian[2 + BAND[j]] += sign * share[j] * signal[j, i] / intensity
    gain = polarity[k] / (on[i] if polarity[k] > 0 else off[i])
    return gain * u - 1, gain * jacobian


def test_normal_equations_are_those_of_a_plain_loop(scene):
    signal, by_p, by_q, offset, *_, pairs = scene
    rows = [[mi.Float(row) for row in table] for table in (signal, by_p, by_q)]
    table = derivative_table(*rows, BAND, N_PIXEL)
    cost, gradient, matrix = normal_equations(
        table, pairs, mi.Float(C_W), N_BAND, mi.Float(SCALE), mi.Float(ROBUST)
    )
    for i in range(N_PIXEL):
        expected = [0.0, np.zeros(2 + N_BAND), np.zeros((2 + N_BAND, 2 + N_BAND))]
        for k in range(offset[i], offset[i + 1]):
            u, jacobian = residual_and_jacobian(scene, i, k)
            r, jacobian = u / SCALE, jacobian / SCALE
            weight = 1 / (1 + (r / ROBUST) ** 2)
            expected[0] += 0.5 * ROBUST**2 * np.log(1 + (r / ROBUST) ** 2)
            expected[1] += weight * r * jacobian
            expected[2] += weight * np.outer(jacobian, jacobian)
        np.testing.assert_allclose(cost.numpy()[i], expected[0], rtol=1e-4, atol=1e-5)
        np.testing.assert_allclose([g.numpy()[i] for g in gradient], expected[1], rtol=1e-3, atol=1e-3)
        triangle = expected[2][np.tril_indices(2 + N_BAND)]
        np.testing.assert_allclose([m.numpy()[i] for m in matrix], triangle, rtol=1e-3, atol=1e-3)


def test_silence_costs_what_exceeds_the_thresholds(scene):
    """The same lists as silent probes, against a plain loop: no cost within the margin, Cauchy's beyond."""
    signal, by_p, by_q, offset, start, end, _, on, off, pairs = scene
    silent = pack_phases(start, end, np.ones(len(start)))
    pairs = replace(pairs, silent_offset=pairs.offset, silent_phases=mi.Float(silent))
    rows = [[mi.Float(row) for row in table] for table in (signal, by_p, by_q)]
    given = mi.Float(C_W), N_BAND, mi.Float(SCALE), mi.Float(ROBUST)
    cost, gradient, _ = silence_equations(derivative_table(*rows, BAND, N_PIXEL), pairs, *given)
    silent_scene = (*scene[:6], np.ones(len(start)), np.ones(N_PIXEL), np.ones(N_PIXEL), pairs)
    n_beyond = 0
    for i in range(N_PIXEL):
        expected, expected_gradient = 0.0, np.zeros(2 + N_BAND)
        for k in range(offset[i], offset[i + 1]):
            change, jacobian = residual_and_jacobian(silent_scene, i, k)
            change += 1
            threshold = on[i] if change > 0 else -off[i]
            r = (change / threshold - 1) / SCALE - SILENT_MARGIN
            if r > 0:
                n_beyond += 1
                expected += 0.5 * ROBUST**2 * np.log(1 + (r / ROBUST) ** 2)
                expected_gradient += r / (1 + (r / ROBUST) ** 2) * jacobian / threshold / SCALE
        np.testing.assert_allclose(cost.numpy()[i], expected, rtol=1e-3, atol=1e-4)
        np.testing.assert_allclose([g.numpy()[i] for g in gradient], expected_gradient, rtol=2e-3, atol=2e-3)
    assert 10 < n_beyond < len(start)


def test_residuals_are_those_of_a_plain_loop(scene):
    signal, *_, offset, _, _, _, on, off, pairs = (scene[0], *scene[3:])
    table = signal_table([mi.Float(row) for row in signal], N_PIXEL)
    pixel = np.repeat(np.arange(N_PIXEL), np.diff(offset))
    k = dr.arange(mi.UInt32, len(pixel))
    u, threshold = relative_residual(table, pairs, mi.Float(C_W), k, mi.UInt32(pixel.astype(np.uint32)), True)
    expected = [residual_and_jacobian(scene, i, j)[0] for j, i in enumerate(pixel)]
    np.testing.assert_allclose(u.numpy(), expected, rtol=1e-4, atol=1e-4)
    polarity = scene[6]
    np.testing.assert_allclose(threshold.numpy(), np.where(polarity > 0, on[pixel], off[pixel]))


def test_gradient_is_that_of_automatic_differentiation(scene):
    """The derivative by log reflectance of the Cauchy cost, through the differentiable residual."""
    signal, by_p, by_q, offset, *_, pairs = scene
    rows = [[mi.Float(row) for row in table] for table in (signal, by_p, by_q)]
    _, gradient, _ = normal_equations(
        derivative_table(*rows, BAND, N_PIXEL),
        pairs,
        mi.Float(C_W),
        N_BAND,
        mi.Float(SCALE),
        mi.Float(ROBUST),
    )
    log_gain = [dr.zeros(mi.Float, N_PIXEL) for _ in range(N_BAND)]
    dr.enable_grad(log_gain)
    table = signal_table([mi.Float(row) * dr.exp(log_gain[b]) for row, b in zip(signal, BAND)], N_PIXEL)
    pixel = mi.UInt32(np.repeat(np.arange(N_PIXEL, dtype=np.uint32), np.diff(offset)))
    k = dr.arange(mi.UInt32, offset[-1])
    u, _ = relative_residual(table, pairs, mi.Float(C_W), k, pixel, True)
    dr.backward(dr.sum(0.5 * ROBUST**2 * dr.log(1 + dr.square(u / (SCALE * ROBUST)))))
    for b in range(N_BAND):
        np.testing.assert_allclose(
            gradient[2 + b].numpy(), dr.grad(log_gain[b]).numpy(), rtol=1e-3, atol=1e-3
        )


def test_threshold_derivatives_are_those_of_finite_differences(scene):
    """The cost of unknown thresholds by their logarithms, events and silence."""
    signal, by_p, by_q, offset, start, end, _, on, off, pairs = scene
    silent = mi.Float(pack_phases(start, end, np.ones(len(start))))
    pairs = replace(pairs, silent_offset=pairs.offset, silent_phases=silent)
    rows = [[mi.Float(row) for row in table] for table in (signal, by_p, by_q)]
    table = derivative_table(*rows, BAND, N_PIXEL)
    wide = mi.Float(C_W), N_BAND, mi.Float(SCALE), mi.Float(ROBUST), True

    for equations in (normal_equations, silence_equations):

        def cost(gain_on, gain_off, equations=equations):
            changed = replace(
                pairs,
                threshold_on=mi.Float(on) * np.exp(gain_on),
                threshold_off=mi.Float(off) * np.exp(gain_off),
            )
            return equations(table, changed, *wide)

        _, gradient, _ = cost(0.0, 0.0)
        for i, step in enumerate(((1e-3, 0.0), (0.0, 1e-3))):
            above, below = cost(*step)[0].numpy(), cost(*(-s for s in step))[0].numpy()
            numeric = (above - below).astype(float) / 2e-3
            np.testing.assert_allclose(gradient[2 + N_BAND + i].numpy(), numeric, rtol=0.02, atol=0.05)
        assert np.abs(gradient[-1].numpy()).max() > 1


def test_all_terms_are_those_of_a_plain_loop(scene, rng):
    """Weights of pairs, a share of the signal that no reflectance scales, thresholds, and the slope term."""
    signal, by_p, by_q, offset, start, end, polarity, on, off, pairs = scene
    share = rng.uniform(0.3, 1, signal.shape).astype(np.float32)
    weight = rng.uniform(0, 2, len(start)).astype(np.float32)
    rows = [[mi.Float(row) for row in table] for table in (signal, by_p, by_q)]
    table = derivative_table(*rows, BAND, N_PIXEL, [mi.Float(row) for row in share * signal])
    given = mi.Float(C_W), N_BAND, mi.Float(SCALE), mi.Float(ROBUST), True, 0.7
    cost, gradient, matrix = normal_equations(table, replace(pairs, weight=mi.Float(weight)), *given)
    n = 2 + N_BAND + 2
    band = np.eye(N_BAND)[BAND]

    def changes(i, k):
        """Change of log I over a pair, and log p_k df/dt, as functions of all unknowns."""

        def light(phase, theta):
            lit = signal[:, i] + by_p[:, i] * theta[0] + by_q[:, i] * theta[1]
            lit = lit * (1 + share[:, i] * (band @ np.expm1(theta[2 : 2 + N_BAND])))
            return mixture(phase) @ lit + C_W, np.append(lit, 0)

        def threshold(theta):
            return (on if polarity[k] > 0 else off)[i] * np.exp(theta[2 + N_BAND + (polarity[k] < 0)])

        def u(theta):
            change = np.log(light(float(end[k]), theta)[0] / light(float(start[k]), theta)[0])
            return polarity[k] * change / threshold(theta) - 1

        def rarity(theta):
            total, lit = light(float(end[k]), theta)
            slot = int(end[k])
            speed = polarity[k] * (lit[ORDER[(slot + 1) % len(ORDER)]] - lit[ORDER[slot]]) / total
            return -np.log(0.5 * (speed + np.hypot(speed, SMALLEST_SLOPE)) / threshold(theta))

        return u, rarity

    def derivative(function):
        return np.array([(function(h) - function(-h)) / 2e-5 for h in 1e-5 * np.eye(n)])

    for i in range(N_PIXEL):
        expected = [0.0, np.zeros(n), np.zeros((n, n))]
        for k in range(offset[i], offset[i + 1]):
            u, rarity = changes(i, k)
            r, jacobian = u(np.zeros(n)) / SCALE, derivative(u) / SCALE
            robust = 1 / (1 + (r / ROBUST) ** 2)
            expected[0] += weight[k] * 0.5 * ROBUST**2 * np.log(1 + (r / ROBUST) ** 2)
            expected[1] += weight[k] * robust * r * jacobian
            expected[2] += weight[k] * robust * np.outer(jacobian, jacobian)
            if np.float32(1 + end[k]) % 1:  # else no LED fades at the event
                expected[0] += weight[k] * 0.7 * rarity(np.zeros(n))
                expected[1] += weight[k] * 0.7 * derivative(rarity)
                expected[2] += weight[k] * 0.7 * np.outer(derivative(rarity), derivative(rarity))
        np.testing.assert_allclose(cost.numpy()[i], expected[0], rtol=1e-3, atol=1e-3)
        np.testing.assert_allclose([g.numpy()[i] for g in gradient], expected[1], rtol=5e-3, atol=1e-2)
        triangle = expected[2][np.tril_indices(n)]
        found = np.array([m.numpy()[i] for m in matrix])
        np.testing.assert_allclose(found, triangle, rtol=5e-3, atol=2e-3 * np.abs(triangle).max() + 1e-6)


@pytest.mark.parametrize("thresholds", [False, True])
def test_the_slope_term_is_the_density_of_event_times(scene, thresholds):
    """Cost -log p_k df/dt / C and its gradient by finite differences of a plain loop."""
    signal, by_p, by_q, offset, start, end, polarity, on, off, pairs = scene
    i = 3
    rows = [[mi.Float(row) for row in table] for table in (signal, by_p, by_q)]
    table = derivative_table(*rows, BAND, N_PIXEL)
    given = (
        table,
        pairs,
        mi.Float(C_W),
        N_BAND,
        mi.Float(SCALE),
        mi.Float(ROBUST),
        thresholds,
    )
    with_term, without = normal_equations(*given, 0.7), normal_equations(*given)

    def cost(change):
        """The slope term of pixel i when p, q, log reflectances and log thresholds change."""
        lit = signal[:, i] + by_p[:, i] * change[0] + by_q[:, i] * change[1]
        lit = lit * np.exp(change[2:][BAND])
        total = 0.0
        for k in range(offset[i], offset[i + 1]):
            slot, phase = int(end[k]) % len(ORDER), float(end[k])
            led = np.append(lit, 0)  # number -1 is darkness
            speed = polarity[k] * (led[ORDER[(slot + 1) % len(ORDER)]] - led[ORDER[slot]])
            speed /= mixture(phase) @ lit + C_W
            threshold = (on if polarity[k] > 0 else off)[i] * np.exp(
                change[2 + N_BAND + (polarity[k] < 0)] if thresholds else 0
            )
            total -= np.log(
                0.5 * (speed + np.hypot(speed, SMALLEST_SLOPE)) / (threshold if thresholds else 1)
            )
        return 0.7 * total

    n = 2 + N_BAND + 2 * thresholds
    assert with_term[0].numpy()[i] - without[0].numpy()[i] == pytest.approx(cost(np.zeros(n)), rel=2e-3)
    steps = 1e-5 * np.eye(n)
    expected = [(cost(s) - cost(-s)) / 2e-5 for s in steps]
    found = [(a.numpy() - b.numpy())[i] for a, b in zip(with_term[1], without[1])]
    np.testing.assert_allclose(found, expected, rtol=1e-3, atol=1e-3)


def test_the_slope_term_balances_robust_residuals_on_average(rng):
    """Of Gaussian residuals z, Cauchy's z psi(z) has the mean that weighs the slope term."""
    z = rng.normal(size=400_000)
    assert gaussian_share(3.0) == pytest.approx(np.mean(z**2 / (1 + z**2 / 9)), rel=0.01)
    assert gaussian_share(1e4) == pytest.approx(1.0, rel=1e-6)
