"""The errors of `experiments.setup_errors` are those that they are named after."""

import numpy as np
import pytest

from evsdr.records import Events, Recording, Schedule, Sensor
from experiments.setup_errors.compute import WRONG

EVENTS = Events(np.array([1], np.uint16), np.array([0], np.uint16), np.array([1], np.int8), np.array([7000]))
TOLD = Recording(
    EVENTS, Sensor(4, 4, 0.2, 0.3, 50.0), Schedule(np.arange(12), 1e4, 1.0), np.array([0, 120_000])
)


def changed(what):
    (wrong,) = [w for w in WRONG if w.what == what]
    return wrong.change(TOLD)


@pytest.mark.parametrize(
    ("what", "move"),
    [
        ("image mirrored in x", np.fliplr),
        ("image mirrored in y", np.flipud),
        ("image turned by 90", np.rot90),
        ("image turned by 180", lambda a: np.rot90(a, 2)),
        ("image turned by 270", lambda a: np.rot90(a, 3)),
        ("x and y swapped", np.transpose),
    ],
)
def test_images(what, move):
    image = np.zeros((4, 4))
    image[0, 1] = 1
    events = changed(what).events
    assert np.argwhere(move(image)).tolist() == [[events.y[0], events.x[0]]]


def test_all_else():
    assert changed("order reversed").schedule.order[0] == 11
    assert changed("order rolled by 8").schedule.order[8] == 0
    assert changed("two LEDs swapped").schedule.order[[3, 10]].tolist() == [10, 3]
    assert changed("polarities flipped").events.p.tolist() == [0]
    assert changed("crossfade told 0 for 1").schedule.crossfade == 0
    assert changed("slots told 10 times too long").schedule.slot_us == 1e5
    assert changed("times in ns").events.t.tolist() == [7_000_000]
    assert changed("times in ms").round_start_us.tolist() == [0, 120]
    assert changed("refractory period 10 times").sensor.refractory_us == 500
    assert changed("thresholds half, known").sensor.contrast_threshold_off == pytest.approx(0.15)
    assert len({wrong.what for wrong in WRONG}) == len(WRONG) == 25
    recorded = {wrong.what: wrong.crossfade for wrong in WRONG if wrong.crossfade != 1}
    assert recorded == {
        f"crossfade told {told} for {true}": true for told, true in ((0, 0.1), (1, 0), (1, 0.3), (1, 0.8))
    }
