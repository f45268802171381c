"""Figures and hints on a recording: each fault is seen, a good one passes."""

import numpy as np
import pytest

from evsdr.records import Events, Recording, Schedule, Sensor
from evsdr.rig.health import Health, examine, hints, rows


def make(x, y, p, t, width=8, height=6, crossfade=1.0) -> Recording:
    order = np.argsort(t, kind="stable")
    kinds = ("u2", "u2", "i1", "i8")
    events = Events(*(np.asarray(a)[order].astype(k) for a, k in zip((x, y, p, t), kinds, strict=True)))
    schedule = Schedule(np.arange(4), 1000.0, crossfade)
    return Recording(events, Sensor(width, height, 0.25, 0.5, 40.0), schedule, np.array([1000, 5000, 9000]))


def test_figures():
    """Half of the pixels fire 6 times in 2 rounds; one of the others 1000 times, all in one millisecond."""
    y, x = np.divmod(np.arange(24), 8)
    x, y, t = np.tile(x, 6), np.tile(y, 6), np.repeat(1000 + 1333 * np.arange(6), 24)
    p = np.repeat([1, 0, 1, 1, 0, 1], 24)
    x, y = np.r_[x, np.full(1000, 3)], np.r_[y, np.full(1000, 5)]
    p, t = np.r_[p, np.tile([1, 1, 0, 1], 250)], np.r_[t, 3000 + np.arange(1000) // 2]
    health = examine(make(x, y, p, t), 2, 1000, 9000)
    assert (health.n_event, health.n_round, health.n_hot) == (1144, 2, 1)
    assert health.seconds == pytest.approx(8e-3)
    assert health.peak_rate == 1.024e6  # its 1000 and 24 of the others
    assert health.lit_share == 25 / 48 and health.events_per_pixel_round == 3
    on = (4 * 24 + 750) / 1144
    assert health.on_share == pytest.approx(on) and health.balance == pytest.approx(on / (1 - on) * 0.5)
    assert dict(rows(health))["events"] == "1,144"


GOOD = dict(
    n_event=10**6, n_round=6, seconds=3.0, peak_rate=1e6, lit_share=0.5,
    events_per_pixel_round=60.0, n_hot=0, on_share=0.6, balance=1.0,
)  # fmt: skip


@pytest.mark.parametrize(
    "changes, sentence",
    [
        ({}, None),
        ({"lit_share": 0.01}, "Only 1.0% of the pixels see the ring"),
        ({"events_per_pixel_round": 3.0}, "fires 3.0 times per round, which is little"),
        ({"events_per_pixel_round": 900.0}, "fires 900 times per round, more than a ring can cause"),
        ({"peak_rate": 9e7}, "90 million events per second"),
        ({"balance": 3.0}, "The ON events tell 3 times the change"),
        ({"n_hot": 100}, "100 pixels fire far more"),
        ({"n_round": 1}, "It has 1 round"),
    ],
)
def test_hints(changes, sentence):
    found = hints(Health(**GOOD | changes), make([0, 1], [0, 0], [0, 1], [1000, 1001], 100, 100))
    assert len(found) == (sentence is not None)
    assert sentence is None or sentence in found[0]


def test_hard_switch_hint():
    found = hints(Health(**GOOD), make([0, 1], [0, 0], [0, 1], [1000, 1001], crossfade=0.1))
    assert len(found) == 1 and "The crossfade is 0.1" in found[0]
