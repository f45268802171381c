import numpy as np
import pytest

from evsdr.limits import theory
from tests.support.analytic import ring_directions

BAND = np.arange(24) % 8
ALL = np.arange(24)


def signals(normal, reflectance, light, band):
    """A_xj = R_b max(0, g_j l_j . n), (n_led, n)."""
    return np.maximum(light @ np.transpose(normal), 0) * np.transpose(reflectance)[band]


# ---------------------------------------------------------------------- the design rule


def test_the_ring_of_the_paper_keeps_the_rule_but_for_the_plane_that_faces_it():
    report = theory.check_ring(ring_directions(), BAND, ALL, 0.05)
    assert report.ratios == (2,) * 8
    assert report.normal_known
    assert report.scale_known
    np.testing.assert_allclose(report.degenerate_normal, [0, 0, 1], atol=1e-12)
    (problem,) = report.problems
    assert "(0.00, 0.00, 1.00)" in problem


def test_a_tilted_ring_is_degenerate_for_its_own_axis():
    turn = np.radians(20)
    rotation = np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]])
    report = theory.check_ring(ring_directions() @ rotation.T, BAND, ALL, 0.05)
    np.testing.assert_allclose(report.degenerate_normal, rotation[:, 2], atol=1e-12)


def test_an_irregular_ring_keeps_the_rule(rng):
    light = ring_directions() * rng.uniform(0.5, 1.5, (24, 1))
    report = theory.check_ring(light, BAND, ALL, 0.05)
    assert report.degenerate_normal is None
    assert report.problems == ()


IRREGULAR = ring_directions() * (1 + 0.4 * np.sin(7.0 * np.arange(24)))[:, None]
LIT = [0.1, 0.3, 0.9]


def log_ratios(light, band, unknowns, constant_light):
    """Logarithms of all intensities over the first."""
    normal = unknowns[:3] / np.linalg.norm(unknowns[:3])
    log = np.log(np.maximum(light @ normal, 0) * np.exp(unknowns[3:])[band] + constant_light)
    return log[1:] - log[0]


@pytest.mark.parametrize(
    ("light", "chosen", "constant_light", "normal", "n_free", "said"),
    [
        (ring_directions(), ALL, 0.05, LIT, 0, "equal light"),  # of another normal
        (ring_directions(), ALL, 0.05, [0, 0, 1], 1, "equal light"),
        (IRREGULAR, ALL, 0.05, [0, 0, 1], 0, None),
        (IRREGULAR, ALL, 0.0, LIT, 1, "no constant light"),
        (IRREGULAR, ALL[:8], 0.05, LIT, 3, "too few ratios to tell normals"),
        (IRREGULAR, [0, 1, 2, 8, 16, 9], 0.05, LIT, 0, "one direction only"),
        (IRREGULAR, [0, 1, 2, 8, 16], 0.0, LIT, 1, "no constant light"),
        (IRREGULAR, [0, 1, 2, 8, 16], 0.05, LIT, 1, "too few ratios"),  # the scale takes one ratio more
        (IRREGULAR, [0, 8, 1, 9], 0.05, LIT, 1, "too few ratios"),
        (IRREGULAR, [0, 8, 1, 9, 2, 10], 0.05, LIT, 0, "one plane"),
    ],
)
def test_free_changes_are_all_that_leave_the_ratios_and_the_report_names_them(
    light, chosen, constant_light, normal, n_free, said, rng
):
    report = theory.check_ring(light, BAND, np.array(chosen), constant_light)
    assert any(said in p for p in report.problems) if said else report.problems == ()
    assert report.scale_known == (n_free == 0 or normal == [0, 0, 1])
    names, band = np.unique(BAND[chosen], return_inverse=True)
    normal, light = np.array(normal) / np.linalg.norm(normal), light[chosen]
    reflectance = rng.uniform(0.2, 0.9, len(names))
    free = theory.free_changes(light, band, normal, reflectance, constant_light)
    assert len(free) == n_free

    at = np.append(normal, np.log(reflectance))
    by = [
        (log_ratios(light, band, at + e, constant_light) - log_ratios(light, band, at - e, constant_light))
        for e in 1e-5 * np.eye(len(at))
    ]
    by = np.array(by).T / 2e-5
    assert np.linalg.matrix_rank(by, tol=1e-5) == len(at) - 1 - n_free  # the normal's length is free, too
    tangent = np.linalg.svd(normal[None])[2][1:]
    for change in free:
        np.testing.assert_allclose(by @ np.append(change[:2] @ tangent, change[2:]), 0, atol=1e-6)


def test_leds_behind_the_horizon_tell_nothing_without_constant_light():
    normal, reflectance = np.array([0.95, 0, 0.3]) / np.linalg.norm([0.95, 0, 0.3]), np.linspace(0.2, 0.9, 8)
    lit = IRREGULAR @ normal > 0
    assert 8 < lit.sum() < 24
    assert set(BAND[lit]) == set(BAND)
    free = theory.free_changes(IRREGULAR, BAND, normal, reflectance, 0.0)
    alone = theory.free_changes(IRREGULAR[lit], BAND[lit], normal, reflectance, 0.0)
    np.testing.assert_allclose(free.T @ free, alone.T @ alone, atol=1e-9)


def test_never_lit_bands_are_named():
    report = theory.check_ring(ring_directions(), BAND, [j for j in ALL if j % 8 not in (3, 7)], 0.05)
    assert report.ratios == (2, 2, 2, -1, 2, 2, 2, -1)
    assert report.problems[0].startswith("Bands 3, 7 are never lit")
    report = theory.check_ring(ring_directions(), BAND, [-1, *ALL[1:8], *ALL[9:16], *ALL[17:]], 0.05)
    assert report.problems[0].startswith("Band 0 is never lit")


def test_leds_in_one_plane_leave_a_circle_of_normals(rng):
    angle = np.radians(np.linspace(-60, 60, 24))
    light = np.column_stack([np.sin(angle), np.zeros(24), np.cos(angle)])
    report = theory.check_ring(light, BAND, ALL, 0.05)
    assert report.ratios == (1,) * 8
    assert not report.normal_known
    assert "(0.00, 1.00, 0.00)" in report.problems[0]
    normal, turned = np.array([[0.1, 0.2, 0.9]]), np.array([[0.1, -0.5, 0.9]])
    lengths = [np.linalg.norm(n) for n in (normal, turned)]
    reflectance = rng.uniform(0.1, 0.5, (1, 8))
    np.testing.assert_allclose(
        signals(normal / lengths[0], reflectance * lengths[0], light, BAND),
        signals(turned / lengths[1], reflectance * lengths[1], light, BAND),
    )


# ---------------------------------------------------------------------- gloss and attached shadow


def least_clean(polar_deg, shininess, threshold):
    """Fewest clean observations of a band that any visible normal keeps, three LEDs 120 degrees apart."""
    normal = np.concatenate([theory.hemisphere_normals(20_000), crucial_normals()])
    light = ring_directions(3, polar_deg)
    return theory.clean_observations(normal, light, np.zeros(3, int), shininess, threshold).min()


def crucial_normals():
    """Normals in the planes through the camera and each LED: where caps end and shadows meet."""
    beta = np.radians(np.linspace(0, 90, 2001))
    return np.concatenate(
        [
            np.column_stack([np.sin(beta) * np.cos(a), np.sin(beta) * np.sin(a), np.cos(beta)])
            for a in 2 * np.pi * np.arange(6) / 6
        ]
    )


def test_guaranteed_range_is_that_of_the_paper():
    np.testing.assert_allclose(theory.polar_angle_range(32, 0.5), (27.51, 60.51), atol=0.005)  # S 25


def test_too_wide_gloss_leaves_no_range():
    assert theory.polar_angle_range(4, 0.5) is None
    assert theory.polar_angle_range(1, 0.1) is None
    assert theory.exact_polar_angle_range(4, 0.5) is None


def test_without_gloss_only_shadows_count():
    high = np.degrees(2 * np.arccos(np.sqrt(2 / 3)))
    for limits in (theory.polar_angle_range(32, 1.0), theory.exact_polar_angle_range(32, 1.0)):
        np.testing.assert_allclose(limits, (0, high), atol=1e-9)


@pytest.mark.parametrize(("shininess", "threshold"), [(32, 0.5), (100, 0.2), (16, 0.5), (12, 0.7)])
def test_brute_force_confirms_both_ranges(shininess, threshold):
    low, high = theory.polar_angle_range(shininess, threshold)
    exact_low, exact_high = theory.exact_polar_angle_range(shininess, threshold)
    assert exact_low < low
    assert high < exact_high
    for polar in (exact_low + 0.2, low, (low + high) / 2, high, exact_high - 0.2):
        assert least_clean(polar, shininess, threshold) >= 1
    for polar in (exact_low - 0.2, exact_high + 0.2):
        assert least_clean(polar, shininess, threshold) == 0


def test_clean_observations_are_counted_per_band():
    normal = np.array([[0, 0, 1], [0.98, -0.2, 0], [np.sin(np.pi / 8), 0, np.cos(np.pi / 8)]])
    light = 5 * np.concatenate([ring_directions(4), [[0, 0, 1]]])
    clean = theory.clean_observations(normal, light, np.array([0, 0, 1, 1, 2]), 32, 0.5)
    # toward the camera: LED 4, on the axis, is glossy; to the lower right: LEDs 0 and 3 alone are lit; on the
    # half-vector of LED 0: that is glossy
    np.testing.assert_array_equal(clean, [[2, 2, 0], [1, 1, 0], [1, 2, 1]])


def test_hemisphere_normals_are_evenly_spread():
    normal = theory.hemisphere_normals(5000)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1)
    assert normal[:, 2].min() >= 0
    np.testing.assert_allclose(normal.mean(axis=0), [0, 0, 0.5], atol=2e-3)
    np.testing.assert_allclose(normal.T @ normal / 5000, np.eye(3) / 3, atol=2e-3)
