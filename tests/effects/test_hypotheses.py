"""What may be told wrong, and what a fit then believes."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from evsdr.effects.hypotheses import (
    clocks,
    faults,
    images,
    orders,
    polarities,
    thresholds,
    too_bright,
    veils,
)
from evsdr.records import Events, Recording, Schedule, Sensor
from tests.support.small_scene import camera, leds, scene
from tests.support.worlds import load


@dataclass(frozen=True)
class World:
    recording: Recording
    hot: np.ndarray | None = None
    thresholds: bool = False
    veil: float | None = None


def world(width=5, height=5, crossfade=1.0):
    """Events of four pixels at four times."""
    column = np.array([0, 1, 4, 2], np.uint16)
    events = Events(column, column[::-1].copy(), np.array([0, 1, 1, 0], np.int8), np.arange(4) * 1000)
    on = np.arange(width * height, dtype=np.float32).reshape(height, width)
    schedule = Schedule(np.array([0, 1, 2, -1, 3], np.int32), 1e4, crossfade, 7.0)
    return World(Recording(events, Sensor(width, height, on, 0.3, 50.0), schedule, np.array([0, 50_000])))


def named(some, words):
    """Give the one hypothesis that says so."""
    (found,) = [h for h in some if words in h.what]
    return found


@pytest.mark.parametrize(
    ("words", "spoil"),
    [
        ("mirrored in x", np.fliplr),
        ("mirrored in y", np.flipud),
        ("by 180", lambda a: np.rot90(a, 2)),
        ("degrees clockwise", lambda a: np.rot90(a, -1)),
        ("counter-clockwise", np.rot90),
        ("swapped", np.transpose),
    ],
)
def test_an_image_is_put_right(words, spoil):
    before = replace(world(), hot=np.arange(25).reshape(5, 5) == 3)
    events, on = before.recording.events, before.recording.sensor.contrast_threshold_on

    def picture(recording):
        out = np.zeros((5, 5), int)
        out[recording.events.y, recording.events.x] = 1 + recording.events.t
        return out

    right = picture(before.recording)
    y, x = np.array([np.argwhere(spoil(right) == 1 + t)[0] for t in events.t]).T.astype(np.uint16)
    sensor = replace(before.recording.sensor, contrast_threshold_on=spoil(on))
    told = replace(before.recording, events=replace(events, x=x, y=y), sensor=sensor)
    found = named(images(told), words).mend(World(told, spoil(before.hot)))
    np.testing.assert_array_equal(picture(found.recording), right)
    np.testing.assert_array_equal(found.recording.sensor.contrast_threshold_on, on)
    np.testing.assert_array_equal(found.hot, before.hot)
    assert found.recording.sensor.contrast_threshold_off == 0.3


def test_only_square_images_are_turned():
    assert len(list(images(world().recording))) == 6
    assert len(list(images(world(7, 5).recording))) == 3


def test_leds_at_fault():
    listed = list(faults([1, 3]))
    assert [h.leds for h in listed] == [(1,), (3,), (1, 3)]
    assert [h.what for h in listed[1:]] == ["LED 3 gives no light", "LEDs 1 and 3 are swapped"]
    order = [h.mend(world()).recording.schedule.order.tolist() for h in listed]
    assert order == [[0, -1, 2, -1, 3], [0, 1, 2, -1, -1], [0, 3, 2, -1, 1]]


def test_orders_are_all_different():
    told = np.arange(6)
    found = [tuple(h.mend(world()).recording.schedule.order) for h in orders(told, 6)]
    assert len(found) == len(set(found)) == 11 and tuple(told) not in found
    assert tuple(told[::-1]) in found and tuple(np.roll(told, 2)) in found
    back = named(orders(told, 6), "starts with 5, 4, 3")
    assert "reversed" in back.what and back.remedy == "write schedule/order = 5, 4, 3, ..."


def test_dark_slots_stay_or_move_along():
    order = world().recording.schedule.order
    found = [h.mend(world()).recording.schedule.order.tolist() for h in orders(order, 4)]
    assert [3, 0, 1, 2, -1] in found  # later
    assert [1, 2, 3, -1, 0] in found  # around the ring
    assert [3, 2, 1, -1, 0] in found  # the other way around


def test_times_and_slots():
    found = {h.what: h.mend(world()).recording for h in clocks(world().recording)}
    assert found["slots last 10 times what is told"].schedule.slot_us == 1e5
    assert found["slots last 0.1 times what is told"].schedule.slot_us == 1e3
    ms = found["times are in ms"]
    assert ms.events.t.tolist() == [0, 1e6, 2e6, 3e6] and ms.round_start_us.tolist() == [0, 5e7]
    assert ms.schedule.start_us == 7000 and found["times are in ns"].round_start_us.tolist() == [0, 50]
    told = named(clocks(world().recording), "in ns").mend(replace(world(), hot=np.ones((5, 5), bool)))
    assert told.hot is None


def test_sensors():
    flipped = named(polarities(), "polarities").mend(world()).recording
    assert flipped.events.p.tolist() == [1, 0, 0, 1]
    assert named(thresholds(world()), "thresholds").mend(world()).thresholds
    assert not list(thresholds(replace(world(), thresholds=True)))


def test_constant_light(tmp_path):
    text = scene(light=leds(4, power=3.0), sensor=camera(width=8, height=8))
    from tests.support.worlds import world_of

    lit = world_of(load(tmp_path, text))
    assert not list(veils(lit))
    assert too_bright(lit).mend(lit).veil == pytest.approx(0.005)
    assert "perhaps 0.005" in too_bright(lit).remedy
    dark = world_of(load(tmp_path, text.replace('value="0.05"', 'value="0"')))
    (found,) = veils(dark)
    believed = found.mend(dark)
    assert believed.veil == pytest.approx(0.3, rel=0.05)
    assert float(believed.illumination().constant_light[0]) == pytest.approx(believed.veil)
