"""The limit of what a recording tells: against the solver, against dense algebra, and where nothing is known."""

from dataclasses import replace

import numpy as np
import pytest

from evsdr.errors import InputError
from evsdr.events.pixel import EventPixel
from evsdr.limits.bound import find_limit, invert_information, unknown_names
from evsdr.limits.information import average_information
from evsdr.records import Schedule
from evsdr.solve.shared.kernel import ON
from evsdr.solve.shared.rig import Basis, Told
from tests.support.analytic import sphere_normals
from tests.support.plans import PIXEL, many, plan_of
from tests.support.sphere import errors, solve, sphere_problem

DIRECTIONS_TOLD = Told(directions_deg=0.0)


def limit_of(normal, mask=None, told=DIRECTIONS_TOLD, repeats=4, **options):
    return find_limit(plan_of(normal, mask, **options), told, repeats)


@pytest.mark.slow
def test_the_solver_reaches_the_limit_over_noise_seeds():
    """Root mean square errors over 20 recordings, pixel by pixel: 3 % are left for Cauchy's cost."""
    size = 24
    normal, mask = sphere_normals(size)
    bound = limit_of(normal, mask, repeats=12).told
    inner = (normal[..., 2] > 0.5)[mask]
    relative, relative_reflectance = [], []
    for seed in range(20):
        problem, truth = sphere_problem(size, event_noise=0.1, seed=seed)
        angle, difference = errors(solve(problem), truth)
        relative.append((angle / bound.normal_sigma_deg[mask])[inner])
        relative_reflectance.append((difference / bound.reflectance_sigma[mask])[inner])
    for values in (np.array(relative), np.array(relative_reflectance)):
        wrong = np.abs(values) > 6  # ended in a wrong minimum, of which the limit knows nothing
        assert np.mean(wrong) < 0.005
        over_seeds = np.sqrt(np.nanmean(np.where(wrong, np.nan, values) ** 2, axis=0))
        assert np.median(over_seeds) == pytest.approx(1.03, abs=0.06)
        assert np.sqrt(np.mean(over_seeds**2)) == pytest.approx(1.03, abs=0.1)


@pytest.mark.parametrize("spread", [0.0, 0.03])
def test_shared_unknowns_are_eliminated_as_from_the_whole_matrix(spread):
    """All pixels' unknowns and what they share in one dense matrix, with its priors."""
    told, n_led = Told(directions_deg=0.7, thresholds=0.2), 24
    normal = np.concatenate([many(v, 2) for v in ([0.3, 0.2, 1], [-0.5, 0.1, 1], [0.1, 0.6, 1])], axis=1)
    plan = plan_of(normal, pixel=replace(PIXEL, spread_on=spread, spread_off=0.5 * spread))
    limit, information = find_limit(plan, told, 2, 3), average_information(plan, 2, 3, True)
    n_pixel, n, m = information.cross.shape
    assert n == 10 + 2 * (spread > 0) and limit.names == (
        "powers",
        "refractory",
        "leak",
        "thresholds",
        "directions",
    )
    basis, width = Basis.of(limit.names, plan.light.band), told.tolerance(plan.schedule.slot_us)
    whole = np.zeros((n_pixel * n + m,) * 2)
    whole[-m:, -m:] = information.shared
    for i, (own, cross) in enumerate(zip(information.own, information.cross)):
        here = slice(i * n, (i + 1) * n)
        whole[here, here], whole[here, -m:], whole[-m:, here] = own, cross, cross.T
        for k, sigma in enumerate((spread / 0.2, 0.5 * spread / 0.2)[: n - 10]):
            apart = np.zeros(len(whole))
            apart[[i * n + 10 + k, n_pixel * n + n_led + ON + k]] = 1, -1
            whole += np.outer(apart, apart) / sigma**2
    change = np.eye(len(whole))[:, : n_pixel * n]
    change = np.column_stack([change, np.vstack([np.zeros((n_pixel * n, len(basis.owner))), basis.vectors])])
    whole = change.T @ whole @ change
    whole += np.diag(np.append(np.zeros(n_pixel * n), [width[name] ** -2 for name in basis.owner]))
    covariance = np.linalg.inv(whole)
    left = basis.vectors @ covariance[n_pixel * n :, n_pixel * n :] @ basis.vectors.T
    np.testing.assert_allclose(limit.shared.vector**2, np.diag(left), rtol=1e-4, atol=1e-14)
    spectrum = plan.reflectance[0, 0]
    for i in range(n_pixel):
        sigma = np.sqrt(np.diag(covariance)[i * n + 2 : i * n + 10]) * spectrum
        np.testing.assert_allclose(limit.unknown.reflectance_sigma[0, i], sigma, rtol=1e-4)
    assert (limit.unknown.normal_sigma_deg > 1.02 * limit.told.normal_sigma_deg).all()


def test_many_pixels_tell_what_they_share():
    """Then hardly anything is lost, but for directions: LEDs may move with a linear map of the normals."""
    normal, mask = sphere_normals(24)
    known, open_ = (limit_of(normal, mask, Told(directions_deg=deg)) for deg in (0.0, 2.0))
    inner = mask & (normal[..., 2] > 0.5)
    lost, more = (
        np.median(v.unknown.normal_sigma_deg[inner] / v.told.normal_sigma_deg[inner]) for v in (known, open_)
    )
    assert 1 < lost < 1.02 < 2 < more
    assert 1e-4 < known.shared.log_power.max() < 0.01 and not known.shared.tilt.any()
    # three turns of all LEDs are free at least, of 48 angles that are told to 2 degrees
    assert np.degrees(np.sqrt(np.mean(open_.shared.tilt**2))) > 2 * np.sqrt(3 / 48)


def test_of_large_objects_a_lattice_is_judged(monkeypatch):
    """What pixels share is told as well as by all of them, and the others are as their neighbours; the rim is left out."""
    normal, mask = sphere_normals(24)
    inner = mask & (normal[..., 2] > 0.5)
    whole = limit_of(normal, inner)
    monkeypatch.setattr("evsdr.limits.bound.MOST", np.count_nonzero(inner) // 3)
    some = limit_of(normal, inner)
    ratio = some.shared.log_power / whole.shared.log_power
    assert np.abs(ratio - 1).max() < 0.1
    for which in ("told", "unknown"):
        few, all_ = (getattr(limit, which) for limit in (some, whole))
        for name in ("normal_sigma_deg", "reflectance_sigma"):
            found, expected = getattr(few, name), getattr(all_, name)
            np.testing.assert_allclose(found[inner][::7].mean(), expected[inner][::7].mean(), rtol=0.15)
            np.testing.assert_array_equal(found[~inner], expected[~inner])
    assert len(np.unique(some.told.normal_sigma_deg[inner])) < 0.35 * np.count_nonzero(inner)
    np.testing.assert_allclose(some.n_pair[inner].mean(), whole.n_pair[inner].mean(), rtol=0.05)


def test_only_a_lag_leaves_its_times_unknown():
    ideal, evk4 = (plan_of(many([0.3, 0.2, 1], 1), pixel=p) for p in (PIXEL, EventPixel()))
    assert unknown_names(ideal, DIRECTIONS_TOLD) == ("powers", "refractory", "leak", "thresholds")
    lag = "tau", "dark", "noise", "shift"
    assert unknown_names(evk4, Told()) == ("powers", *lag, "refractory", "leak", "thresholds", "directions")


@pytest.fixture(scope="module")
def patch():
    """A few normals away from the degenerate one."""
    normal, mask = sphere_normals(12)
    return normal, mask & (normal[..., 2] > 0.6) & (normal[..., 2] < 0.95)


def test_sigma_grows_with_the_noise_and_shrinks_with_the_rounds(patch):
    """A little less than with the noise: times and silence tell more of it."""
    normal, mask = patch
    one, noisy, long = (
        limit_of(normal, mask, pixel=replace(PIXEL, event_noise=noise), n_round=n).told.normal_sigma_deg[mask]
        for noise, n in ((0.1, 3), (0.3, 3), (0.1, 12))
    )
    assert 2.2 < np.median(noisy / one) < 3
    assert np.median(long / one) == pytest.approx(0.5, abs=0.05)


def test_pixels_and_bands_without_information_say_so(patch):
    normal, mask = patch
    without_3 = Schedule(np.array([j for j in range(24) if j % 8 != 3]), 10_000.0, 1.0)
    limit = limit_of(normal, mask, schedule=without_3)
    assert (limit.n_pair[~mask] == 0).all() and (limit.n_pair[mask] > 20).all()
    for bound in (limit.told, limit.unknown):
        assert (bound.normal_sigma_deg[~mask] == 180).all()
        assert (bound.reflectance_sigma[~mask] == 1).all()
        assert (bound.normal_sigma_deg[mask] < 10).all()
        assert (bound.reflectance_sigma[mask][:, 3] == 1).all()
        assert (np.delete(bound.reflectance_sigma[mask], 3, axis=1) < 0.5).all()


def test_one_direction_per_band_tells_nothing(patch):
    normal, mask = patch
    limit = limit_of(normal, mask, schedule=Schedule(np.arange(8), 10_000.0, 1.0))
    assert (limit.n_pair[mask] > 0).any()
    assert (limit.told.normal_sigma_deg == 180).all()
    assert (limit.told.reflectance_sigma == 1).all()


def test_without_constant_light_only_normals_are_known(patch):
    normal, mask = patch
    bound = limit_of(normal, mask, constant_light=0.0).told
    assert (bound.normal_sigma_deg[mask] < 10).all()
    assert (bound.reflectance_sigma == 1).all()


def test_a_surface_that_faces_the_ring_has_no_scale_but_a_normal():
    bound = limit_of(many([0, 0, 1], 1)).told
    assert bound.normal_sigma_deg[0, 0] < 5
    np.testing.assert_array_equal(bound.reflectance_sigma, 1)


def test_no_events_are_an_error(patch):
    normal, mask = patch
    with pytest.raises(InputError, match="two events"):
        limit_of(normal, mask, constant_light=1e4)


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
