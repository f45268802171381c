"""Events against the grain, and the frequency that they keep."""

import numpy as np
import pytest

from evsdr.records import Schedule
from evsdr.viewing.flicker import find_flicker, spectrum
from evsdr.viewing.sample import Sample


def test_a_beat_is_found_at_its_frequency(rng):
    t = np.sort(rng.integers(0, 2_000_000, 4000))
    p = np.where(np.sin(2e-6 * np.pi * 117.0 * t) > 0, 1, -1)
    hz, beat = spectrum(t, p, t)
    assert hz[np.argmax(beat)] == pytest.approx(117, abs=0.4)
    assert beat.max() == pytest.approx(2 / np.pi, abs=0.05)  # mean of |sin|
    assert np.median(beat) < 0.05


def test_only_late_turns_within_a_slot_count():
    """Pairs are: up-up early, up-down early, down-up late, then the next slot, in which one follows another."""
    schedule = Schedule(np.array([0, 1]), 1000.0, 1.0)
    t, p = np.array([50, 100, 150, 600, 900, 1300, 1700]), np.array([1, 1, -1, -1, 1, 1, -1])
    found = find_flicker(Sample(np.array([0]), np.zeros(7, int), t, p), schedule, np.empty(0))
    assert found.n == 2  # at 900 and 1700
    assert found.share == pytest.approx(2 / 2)
    assert found.mains_hz == 0
