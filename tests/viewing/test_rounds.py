"""Trigger edges: the grid they lie on, what is missing, what is too many."""

import numpy as np
import pytest

from evsdr.rig.camera_file import Edges
from evsdr.viewing.rounds import find_triggers


def edges(*inputs):
    """Make rising edges of several inputs."""
    t, number = np.concatenate(inputs), np.repeat(np.arange(len(inputs)), [len(i) for i in inputs])
    return Edges(np.ones(len(t), int), np.array(t, np.int64), number)


def test_a_grid_with_a_gap_a_stray_and_jitter(rng):
    t = 1_000 + 50_000 * np.arange(20) + rng.integers(-30, 30, 20)
    given = np.sort(np.append(np.delete(t, [4, 11]), 123_456))
    found = find_triggers(edges(given))
    assert found.round_us == pytest.approx(50_000, abs=10)
    np.testing.assert_array_equal(found.missing, [4, 11])
    np.testing.assert_array_equal(found.stray_us, [123_456])
    assert 10 < np.abs(found.deviation_us).max() < 60
    np.testing.assert_allclose(found.start_us, t, atol=100)


def test_of_several_inputs_the_one_that_fits_is_taken():
    t = 50_000 * np.arange(10)
    other = 7_000 * np.arange(60)
    assert find_triggers(edges(other, t), 49_900).round_us == pytest.approx(50_000)
    assert find_triggers(edges(other, t)).round_us == pytest.approx(7_000)


def test_too_few_edges_are_none():
    assert find_triggers(edges([5])) is None
    assert find_triggers(Edges(np.zeros(4, int), np.arange(4) * 100, np.zeros(4, int))) is None
