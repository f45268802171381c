"""What pixels share as a vector, in which directions it may move, and how well it is told."""

from dataclasses import replace

import numpy as np
import pytest

from evsdr.solve.shared.rig import CONSIDERED, GROUPS, N_TIMING, NAMES, TIMES, Basis, Rig, Told, across

BAND = [0, 1, 2, 0, 1, 0]  # band 2 has one LED


def test_a_rig_is_read_as_it_is_written():
    vector = np.arange(3.0 * 6 + N_TIMING)
    rig = Rig.of(vector, 6)
    np.testing.assert_array_equal(rig.vector, vector)
    assert [getattr(rig, name) for name in TIMES] == [6, 7, 8, 9, 10, 11, 12]
    assert rig.log_power.tolist() == [0, 1, 2, 3, 4, 5] and rig.log_threshold.tolist() == [13, 14]
    assert rig.distance == 15 and rig.tilt.shape == (6, 2) and rig.tilt[1].tolist() == [18, 19]
    np.testing.assert_array_equal(np.flatnonzero(replace(rig, shift=-1.0).vector != vector), [9])


def test_groups_hold_all_names_once_but_what_is_only_considered():
    assert sorted([CONSIDERED, *(name for group in GROUPS.values() for name in group)]) == sorted(NAMES)


def test_all_directions_are_orthonormal_and_powers_of_a_band_add_up_to_0():
    basis = Basis.of(NAMES, BAND)
    n_power = 6 - 3  # one gain less in each band
    assert basis.vectors.shape == (3 * 6 + N_TIMING, n_power + N_TIMING + 12)
    np.testing.assert_allclose(basis.vectors.T @ basis.vectors, np.eye(len(basis.owner)), atol=1e-12)
    powers = basis.vectors[:6]
    for b in range(3):
        np.testing.assert_allclose(powers[np.array(BAND) == b].sum(axis=0), 0, atol=1e-12)
    count = {name: int(np.sum(basis.owner == name)) for name in NAMES}
    assert count == {name: 1 for name in (*TIMES, "distance")} | {
        "powers": 3,
        "thresholds": 2,
        "directions": 12,
    }


@pytest.mark.parametrize("name", NAMES)
def test_a_direction_moves_what_it_is_named_after(name):
    basis = Basis.of((name,), BAND)
    zero = Rig.of(np.zeros(3 * 6 + N_TIMING), 6)
    moved = Rig.of(basis.vectors @ np.ones(len(basis.owner)), 6)
    part = {"powers": "log_power", "thresholds": "log_threshold", "directions": "tilt"}.get(name, name)
    assert np.any(getattr(moved, part))
    np.testing.assert_array_equal(replace(moved, **{part: getattr(zero, part)}).vector, zero.vector)


def test_nothing_unknown_is_no_direction():
    assert Basis.of((), BAND).vectors.shape == (3 * 6 + N_TIMING, 0)
    assert Basis.of(("powers",), [0, 1, 2]).vectors.shape == (3 * 3 + N_TIMING, 0)  # no two LEDs of a band


def test_tolerances_are_in_the_units_of_a_rig():
    told = Told(
        tau_us=20, shift_us=30, refractory_us=40, directions_deg=90, powers=0.1, dark=0.2, noise=0.3, leak=0.5
    )
    found = told.tolerance(10.0)
    assert found == pytest.approx(
        dict(
            tau=2, shift=3, refractory=4, directions=np.pi / 2, powers=0.1, dark=0.2, noise=0.3, leak=5e-6,
            thresholds=told.thresholds, pole=told.pole, distance=told.distance,
        )
    )  # fmt: skip
    assert set(found) == set(NAMES)


@pytest.mark.parametrize(
    "direction", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.6, 0.0, 0.8), (-0.5, 0.5, 0.5**0.5)]
)
def test_two_ways_across_a_direction(direction):
    frame = np.vstack([across(np.array(direction, float)), direction])
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-12)
