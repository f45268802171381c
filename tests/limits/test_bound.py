from dataclasses import replace

import mitsuba as mi
import numpy as np
import pytest

from evsdr.errors import InputError
from evsdr.events.pairs import pair_events
from evsdr.events.pixel import EventPixel
from evsdr.events.simulator import simulate_events
from evsdr.limits.bound import event_pair_bound, invert_information
from evsdr.model.illumination import Illumination
from evsdr.records import Recording, Schedule, Sensor
from tests.support.analytic import lambert_signals, ring_directions, sphere_normals
from tests.support.sphere import C_W, PAIRS_ALONE, SPECTRUM, errors, solve, sphere_problem

THRESHOLDS = {"contrast_threshold_on": 0.2, "contrast_threshold_off": 0.2}
PIXEL = replace(EventPixel.ideal(), **THRESHOLDS, event_noise=0.1)
SCHEDULE = Schedule(np.arange(24), 10_000.0, 1.0)


def light_of(constant_light=C_W, power=(1,) * 24):
    return Illumination(
        [mi.Vector3f(*d) for d in ring_directions().tolist()],
        [mi.Float(float(g)) for g in power],
        [j % 8 for j in range(24)],
        mi.Float(constant_light),
    )


def bound_of(normal, mask, constant_light=C_W, schedule=SCHEDULE, pixel=PIXEL, n_round=6, spectrum=SPECTRUM):
    reflectance = np.broadcast_to(spectrum, (*mask.shape, 8))
    signal = np.where(mask, lambert_signals(normal, reflectance, ring_directions()), 0)
    light = light_of(constant_light)
    return event_pair_bound(signal, normal, reflectance, mask, light, schedule, n_round, pixel)


def test_bound_is_that_of_finite_differences(rng):
    """In other unknowns (angles of the normal, reflectance itself) and by plain NumPy."""
    polar, azimuth = np.array([[0.3, 0.9, 0.6]]), np.array([[0.4, 2.0, -1.1]])
    pixel = replace(PIXEL, contrast_threshold_off=0.3, event_noise=0.07)
    schedule = Schedule(np.array([3, 0, 8, 16, 11, 19, -1, *np.arange(24)]), 10_000.0, 0.6)
    power = rng.uniform(0.5, 1.5, 24)

    def normal_at(polar, azimuth):
        s = np.sin(polar)
        return np.stack([s * np.cos(azimuth), s * np.sin(azimuth), np.cos(polar)], axis=-1)

    def signals(unknown):
        shade = np.maximum(ring_directions() @ normal_at(*unknown[:2]), 0) * power
        return np.append(shade * unknown[2:][np.arange(24) % 8], 0)  # the last one, -1, is darkness

    unknowns = np.column_stack([polar[0], azimuth[0], np.tile(SPECTRUM, (3, 1))])
    signal = np.stack([signals(u)[:24] for u in unknowns], axis=-1)[:, None, :]
    mask = np.ones((1, 3), bool)
    reflectance = np.tile(SPECTRUM, (1, 3, 1))
    normal = normal_at(polar, azimuth)
    bound = event_pair_bound(signal, normal, reflectance, mask, light_of(power=power), schedule, 5, pixel)

    events, *_, starts = simulate_events(signal, C_W, schedule, 5, replace(pixel, event_noise=0.0))
    pairs = pair_events(Recording(events, Sensor(3, 1, 0.2, 0.3, pixel.refractory_us), schedule, starts))
    order = np.append(schedule.order, schedule.order[0])
    for i, unknown in enumerate(unknowns):
        own = slice(pairs.offset[i], pairs.offset[i + 1])

        def residuals(unknown, own=own):
            table, logs = signals(unknown), []
            for phase in (pairs.phase_start[own], pairs.phase_end[own]):
                slot = phase.astype(int)
                fade = phase.astype(float) - slot
                logs.append(np.log((1 - fade) * table[order[slot]] + fade * table[order[slot + 1]] + C_W))
            polarity = pairs.polarity[own]
            return polarity * (logs[1] - logs[0]) / np.where(polarity > 0, 0.2, 0.3) / 0.07

        jacobian, turn = (
            np.array([(f(unknown + e) - f(unknown - e)) / 2e-5 for e in 1e-5 * np.eye(10)]).T
            for f in (residuals, lambda u: normal_at(*u[:2]))
        )
        covariance = np.linalg.inv(jacobian.T @ jacobian)
        angle = np.degrees(np.sqrt(np.trace(turn @ covariance @ turn.T)))
        assert bound.normal_sigma_deg[0, i] == pytest.approx(angle, rel=0.01)
        np.testing.assert_allclose(bound.reflectance_sigma[0, i], np.sqrt(np.diag(covariance))[2:], rtol=0.01)
        assert bound.n_pair[0, i] == own.stop - own.start > 20


@pytest.mark.slow
def test_the_solver_reaches_the_bound_over_noise_seeds():
    """Root mean square errors over 20 recordings, pixel by pixel, from event pairs alone."""
    size = 24
    normal, mask = sphere_normals(size)
    bound = bound_of(normal, mask)
    inner = (normal[..., 2] > 0.5)[mask]
    relative, relative_reflectance = [], []
    for seed in range(20):
        problem, truth = sphere_problem(size, event_noise=0.1, seed=seed)
        angle, difference = errors(solve(problem, recipe=PAIRS_ALONE), truth)
        relative.append((angle / bound.normal_sigma_deg[mask])[inner])
        relative_reflectance.append((difference / bound.reflectance_sigma[mask])[inner])
    for values in (np.array(relative), np.array(relative_reflectance)):
        wrong = np.abs(values) > 6  # ended in a wrong minimum, of which the bound knows nothing
        assert np.mean(wrong) < 0.005
        over_seeds = np.sqrt(np.nanmean(np.where(wrong, np.nan, values) ** 2, axis=0))
        assert np.median(over_seeds) == pytest.approx(1, abs=0.1)
        assert np.sqrt(np.mean(over_seeds**2)) == pytest.approx(1, abs=0.15)


@pytest.fixture(scope="module")
def patch():
    """A few normals away from the degenerate one."""
    normal, mask = sphere_normals(12)
    return normal, mask & (normal[..., 2] > 0.6) & (normal[..., 2] < 0.95)


def test_sigma_grows_with_the_noise_and_shrinks_with_the_rounds(patch):
    normal, mask = patch
    one, noisy, long = (
        bound_of(normal, mask, pixel=replace(PIXEL, event_noise=noise), n_round=n)
        for noise, n in ((0.1, 3), (0.3, 3), (0.1, 12))
    )
    np.testing.assert_allclose(noisy.normal_sigma_deg[mask], 3 * one.normal_sigma_deg[mask], rtol=0.01)
    assert np.median(long.normal_sigma_deg[mask] / one.normal_sigma_deg[mask]) == pytest.approx(0.5, abs=0.05)


def test_pixels_and_bands_without_information_say_so(patch):
    normal, mask = patch
    without_3 = Schedule(np.array([j for j in range(24) if j % 8 != 3]), 10_000.0, 1.0)
    bound = bound_of(normal, mask, schedule=without_3)
    assert (bound.normal_sigma_deg[~mask] == 180).all()
    assert (bound.reflectance_sigma[~mask] == 1).all()
    assert (bound.n_pair[~mask] == 0).all()
    assert (bound.normal_sigma_deg[mask] < 10).all()
    assert (bound.reflectance_sigma[mask][:, 3] == 1).all()
    assert (np.delete(bound.reflectance_sigma[mask], 3, axis=1) < 0.5).all()


def test_one_direction_per_band_tells_nothing(patch):
    normal, mask = patch
    bound = bound_of(normal, mask, schedule=Schedule(np.arange(8), 10_000.0, 1.0))
    assert (bound.n_pair[mask] > 0).any()
    assert (bound.normal_sigma_deg == 180).all()
    assert (bound.reflectance_sigma == 1).all()


def test_without_constant_light_only_normals_are_known(patch):
    normal, mask = patch
    bound = bound_of(normal, mask, constant_light=0.0)
    assert (bound.normal_sigma_deg[mask] < 10).all()
    assert (bound.reflectance_sigma == 1).all()


def test_a_surface_that_faces_the_ring_has_no_scale_but_a_normal():
    normal = np.broadcast_to([0.0, 0.0, 1.0], (1, 1, 3))
    bound = bound_of(normal, np.ones((1, 1), bool))
    assert bound.normal_sigma_deg[0, 0] < 5
    np.testing.assert_array_equal(bound.reflectance_sigma, 1)


def test_no_events_are_an_error(patch):
    normal, mask = patch
    with pytest.raises(InputError):
        bound_of(normal, mask, constant_light=1e4)


def test_information_is_inverted_and_what_it_leaves_open_is_named(rng):
    root = rng.normal(size=(1, 4, 4)) * [1, 10, 100, 1000]
    full = np.swapaxes(root, 1, 2) @ root
    covariance, known = invert_information(full)
    assert known.all()
    np.testing.assert_allclose(covariance @ full, np.eye(4)[None], atol=1e-6)
    jacobian = np.array([[1.0, 2.0, 0, 0, 0], [2.0, -1.0, 0, 0, 0], [0, 0, 3.0, 3.0, 0]])
    covariance, known = invert_information((jacobian.T @ jacobian)[None])
    np.testing.assert_array_equal(known[0], [True, True, False, False, False])
    np.testing.assert_allclose(covariance[0, :2, :2], np.eye(2) / 5)
