"""A sample of pixels, and how far their events agree in a slot."""

import numpy as np
import pytest

from evsdr.records import Events, Schedule
from evsdr.viewing.sample import Sample, coherence, take_sample


def test_a_sample_leaves_out_hot_and_idle_pixels(rng):
    n = 4000
    x, y = rng.integers(0, 6, n).astype(np.uint16), rng.integers(0, 5, n).astype(np.uint16)
    busy = ~((x == 5) & (y == 0))
    events = Events(x[busy], y[busy], rng.integers(0, 2, busy.sum()).astype(np.int8), np.arange(busy.sum()))
    hot = np.zeros((5, 6), bool)
    hot[2, 3] = True
    sample = take_sample(events, (5, 6), hot)
    np.testing.assert_array_equal(sample.place, np.setdiff1d(np.arange(30), [5, 2 * 6 + 3]))
    assert (np.diff(sample.pixel) >= 0).all()
    assert (np.diff(sample.t)[sample.together] > 0).all()
    mine = (events.x == 1) & (events.y == 4)
    np.testing.assert_array_equal(sample.p[sample.place[sample.pixel] == 25], 2 * events.p[mine] - 1)
    assert len(take_sample(events, (5, 6), hot, n_pixel=7).place) == 7


def test_coherence_counts_what_agrees():
    """Slot 0 has three events of one polarity and one of the other, slot 1 two that agree, slot 2 a lone one."""
    schedule = Schedule(np.array([0, 1, 2]), 100.0, 1.0)
    t, p = np.array([10, 50, 310, 350, 110, 420, 250]), np.array([1, 1, 1, -1, -1, -1, 1])
    sample = Sample(np.array([0]), np.zeros(7, int), t, p)
    assert coherence(sample, schedule, np.empty(0)) == pytest.approx((2 + 2) / 6)
