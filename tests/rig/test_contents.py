"""What a recording holds, for whoever does not know how the ring ran."""

import numpy as np
import pytest

from evsdr.rig.contents import repetition_us, rows
from tests.support.camera_files import make_recording
from tests.support.ring_log import ROUND_US, STARTS, pulses

PERIOD_US = 96_000


def periodic(rng, n_round=4):
    """Events under eight LEDs, one after the other from left and right, that are alike in pairs."""
    rate = np.repeat(np.tile(rng.uniform(0.3, 1, 4), 2), 12) * np.tile(np.hanning(12), 8)
    k = np.tile(np.repeat(np.arange(96), (60 * rate).astype(int)), n_round)
    t = (
        1000 * k
        + np.repeat(np.arange(n_round) * PERIOD_US, len(k) // n_round)
        + rng.integers(0, 1000, len(k))
    )
    order = np.argsort(t)
    x = np.where(k < 48, rng.integers(0, 40, len(k)), rng.integers(24, 64, len(k)))
    return make_recording(x[order], rng.integers(0, 48, len(k)), rng.integers(0, 2, len(k)), t[order])


def test_the_round_is_found(rng):
    assert repetition_us(periodic(rng)) == pytest.approx(PERIOD_US, rel=0.01)
    zeros = np.zeros(5000, int)
    assert repetition_us(make_recording(zeros, zeros, zeros, np.sort(rng.integers(0, 400_000, 5000)))) is None
    assert repetition_us(make_recording([1, 2], [1, 2], [0, 1], [0, 1])) is None


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
