"""What the page of a preview is told: whether the schedule is locked, in words, and a picture of each LED."""

import base64
import json
import re
from dataclasses import replace

import numpy as np
import pytest

from evsdr.viewing.moment import lock, moment, sharpness
from evsdr.viewing.sums import Sums
from tests.support.grown_files import as_camera, ball
from tests.support.watched_files import N_LED, SIZE, ball_signal


def sums_of(camera=None, **told):
    sums = Sums(replace(ball().schedule, **told), SIZE, SIZE)
    sums.add(camera or as_camera(ball()))
    return sums


LATE = replace(as_camera(ball()), edges=replace(as_camera(ball()).edges, t=as_camera(ball()).edges.t + 2500))


@pytest.mark.parametrize(
    ("sums", "state", "words"),
    [
        (Sums(ball().schedule, SIZE, SIZE), "waiting", "No events"),
        (sums_of(as_camera(ball(), end=50_000)), "waiting", "first round is not over"),
        (sums_of(), "locked", r"5 triggers, every 60 ms; 9\d% of the events"),
        (sums_of(as_camera(ball(), triggers=False)), "not locked", "No trigger came in 0.2 s: switch"),
        (sums_of(slot_us=6000.0), "not locked", "every 60 ms, but a round of this schedule lasts 72 ms"),
        (sums_of(LATE), "not locked", "look for other light"),
    ],
)
def test_the_lock_is_told_in_words(sums, state, words):
    told = lock(sums)
    assert told.state == state and re.search(words, told.words), told


def test_blur_lowers_the_sharpness_and_brightness_does_not(rng):
    level = np.where(np.indices((24, 24)).sum(0) // 6 % 2, 1.0, -1.0)[None]
    blurred = (level + np.roll(level, 1, 1) + np.roll(level, 1, 2) + np.roll(level, (1, 1), (1, 2))) / 4
    seen = rng.random((24, 24)) < 0.9
    sharp = sharpness(level, seen)
    assert sharpness(blurred, seen) < 0.8 * sharp and sharpness(3 * level + 1, seen) == sharp
    assert sharpness(rng.normal(size=(1, 100, 100)), np.ones((100, 100), bool)) == pytest.approx(1, abs=0.02)
    assert sharpness(level, np.zeros((24, 24), bool)) is None and sharpness(0 * level, seen) is None


def test_pictures_show_what_each_led_lights():
    told = json.loads(json.dumps(moment(sums_of(), skipped=3), allow_nan=False))
    picture = told["picture"]
    shown = np.frombuffer(base64.b64decode(picture["data"]), np.uint8).reshape(N_LED, SIZE, SIZE).astype(int)
    assert picture["leds"] == list(range(N_LED)) and (picture["width"], picture["height"]) == (SIZE, SIZE)
    lit = ball_signal().sum(0) > 0
    assert (shown[:, ~lit] == 0).mean() > 0.95
    # The brightest side of the ball is that of the LED
    column = np.arange(SIZE) - (SIZE - 1) / 2
    side = [(shown[k] * (shown[k] > 128) * column).sum() for k in (0, N_LED // 2)]
    assert side[0] > 0 > side[1]
    assert told["skipped"] == 3 and told["state"] == "locked" and told["ended"] is False


def test_before_a_file_has_come_trouble_is_told():
    assert moment(None)["words"] == "The camera has not begun to write yet."
    assert moment(None, trouble="no RAW file.", ended=True) | {"n_event": 0} == {
        "state": "waiting", "words": "no RAW file.", "n_event": 0, "ended": True,
    }  # fmt: skip
