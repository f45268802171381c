"""Scene, recording and mask that do not go together are refused in a sentence."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from evsdr.errors import InputError
from evsdr.fitting.checks import (
    EVENT_BYTES,
    FIT_BYTES,
    KEPT,
    MAX_BANDS,
    RESERVED,
    THREAD_BYTES,
    as_recorded,
    check_fit,
    check_room,
    object_mask,
)
from evsdr.fitting.settings import Settings
from evsdr.records import Events, Recording, Schedule, Sensor

RING = SimpleNamespace(path="a.xml", width=4, height=3, leds=SimpleNamespace(n_led=8, n_band=2))
GOOD = Recording(
    Events(*np.zeros((4, 2), int)),
    Sensor(4, 3, 0.2, 0.3, 50.0),
    Schedule(np.arange(8), 1e4, 1.0),
    np.zeros(0),
)


def test_what_goes_together():
    check_fit(RING, GOOD, Settings())


@pytest.mark.parametrize(
    ("recording", "sentence"),
    [
        (
            replace(GOOD, sensor=replace(GOOD.sensor, width=5), source="b.h5"),
            "^a.xml: the film is 4 x 3 pixels but the events of b.h5 are 5 x 3; make the film as large",
        ),
        (
            replace(GOOD, sensor=replace(GOOD.sensor, contrast_threshold_off=np.array([0.2, 11]))),
            "^the recording: contrast_threshold_off goes from 0.2 to 11;",
        ),
        (
            replace(GOOD, schedule=replace(GOOD.schedule, order=np.array([0, 8]))),
            "^the recording: schedule/order lights LED 8, but a.xml has only 8 LEDs",
        ),
    ],
)
def test_what_does_not(recording, sentence):
    with pytest.raises(InputError, match=sentence):
        check_fit(RING, recording, Settings())


@pytest.mark.parametrize(
    ("free", "what"), [("free_memory", "memory"), ("free_address_space", "address space")]
)
def test_a_fit_without_room_is_refused_by_the_events_of_its_pixels(monkeypatch, free, what):
    few, many = np.eye(3, 4) > 1, np.eye(3, 4) > 0
    recording = replace(GOOD, events=Events(*np.zeros((4, 10**6), int)), source="b.h5")
    monkeypatch.setenv("EVSDR_THREADS", "3")
    room = FIT_BYTES + 0.9 * EVENT_BYTES * 10**6
    if what != "memory":
        room = FIT_BYTES + RESERVED + 3 * THREAD_BYTES + 0.9 * KEPT * EVENT_BYTES * 10**6
    monkeypatch.setattr(f"evsdr.errors.{free}", lambda: room)
    check_room(recording, few)
    with pytest.raises(
        InputError, match=f"^b.h5: a fit of 1000000 events would need 0.* GiB of {what}, but 0"
    ):
        check_room(recording, many)


def lit(trim=None, on=None):
    return replace(GOOD, schedule=replace(GOOD.schedule, trim=trim, constant_light_on=on), source="b.h5")


def test_leds_are_as_bright_as_they_were():
    ring = SimpleNamespace(**vars(RING), constant_light=0.05, trimmed=lambda trim: trim.tolist())
    for untold in (None, np.ones(24)):
        assert as_recorded(ring, lit(untold, True))[0] is ring
    trim, recording = as_recorded(ring, lit(np.array([1, 0.5, 0, *[1] * 21])))
    assert trim == [1, 0.5, *[1] * 6]
    assert recording.schedule.order.tolist() == [0, 1, -1, 3, 4, 5, 6, 7]


@pytest.mark.parametrize(
    ("light", "recording", "sentence"),
    [
        (
            0.05,
            lit(on=False),
            r"^b.h5: its constant light was off but a.xml has a constant_light of 0.05; make it 0",
        ),
        (0.0, lit(on=True), r"^b.h5: its constant light was on but .* of 0; make it above 0"),
        (0.05, lit(np.ones(7)), "^b.h5: schedule/trim must hold 8 numbers"),
        (0.05, lit(np.full(8, 1.5)), "^b.h5: schedule/trim must hold 8 numbers"),
        (0.05, lit(np.zeros(8)), "^b.h5: schedule/trim is 0 for all"),
    ],
)
def test_light_that_contradicts_the_recording(light, recording, sentence):
    with pytest.raises(InputError, match=sentence):
        as_recorded(SimpleNamespace(**vars(RING), constant_light=light), recording)


def test_many_bands_are_for_adam():
    ring = SimpleNamespace(**vars(RING) | {"leds": SimpleNamespace(n_led=64, n_band=MAX_BANDS + 1)})
    check_fit(ring, GOOD, Settings(solver="adam"))
    with pytest.raises(InputError, match="41 bands are too many"):
        check_fit(ring, GOOD, Settings())


def test_pixels_of_the_object_and_the_mask():
    coverage = np.zeros((3, 4))
    coverage[1:] = 0.6
    np.testing.assert_array_equal(object_mask(RING, coverage, None), coverage > 0)
    wanted = np.zeros((3, 4), int)
    wanted[:, 2] = 7
    np.testing.assert_array_equal(object_mask(RING, coverage, wanted), (coverage > 0) & (wanted > 0))


@pytest.mark.parametrize(
    ("coverage", "wanted", "sentence"),
    [
        (0.4, None, "^a.xml: the camera does not see"),
        (1.0, np.zeros((3, 4)), "^the mask: the mask has no pixel"),
        (1.0, np.ones((4, 3)), r"^the mask has shape \(4, 3\)"),
        (1.0, "none.png", "^none.png: no such file"),
    ],
)
def test_masks_that_leave_nothing(coverage, wanted, sentence):
    with pytest.raises(InputError, match=sentence):
        object_mask(RING, np.full((3, 4), coverage), wanted)
