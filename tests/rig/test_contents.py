"""What a recording holds, for whoever does not know how the ring ran."""

import numpy as np
import pytest

from evsdr.rig.contents import repetition_us, rows
from tests.support.camera_files import make_recording
from tests.support.ring_log import ROUND_US, STARTS, pulses

PERIOD_US = 96_000


def periodic(rng, n_round=4):
    """Times of events under eight LEDs that fade into each other, each as bright as it likes."""
    rate = np.repeat(rng.uniform(0.3, 1, 8), 12) * np.tile(np.hanning(12), 8)
    t = np.concatenate(
        [k * PERIOD_US + 1000 * np.repeat(np.arange(96), (60 * rate).astype(int)) for k in range(n_round)]
    )
    return np.sort(t + rng.integers(0, 1000, len(t)))


def test_the_round_is_found(rng):
    assert repetition_us(periodic(rng)) == pytest.approx(PERIOD_US, rel=0.01)
    assert repetition_us(np.sort(rng.integers(0, 400_000, 5000))) is None
    assert repetition_us(np.array([0, 1])) is None


def test_all_is_told():
    edges = pulses(STARTS, trigger_id=2)
    told = dict(
        rows(make_recording([1, 2, 2], [0, 0, 0], [0, 1, 1], [10, 20, 1_000_010], edges.p, edges.t, edges.id))
    )
    assert told["sensor"] == "64 x 48 pixels" and told["events"] == "3"
    assert told["ON events"] == "66.7%"
    assert told["trigger input 2, rising"] == f"6 from 0.007000 s, {1e-3 * ROUND_US:g} ms apart"
    assert told["trigger input 2, falling"].startswith("6 from 0.007200 s")
    assert dict(rows(make_recording([1, 2], [0, 0], [0, 1], [10, 20])))["triggers"] == "none"
