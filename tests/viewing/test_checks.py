"""Each fault of a recording is found, by the check that should find it; nothing is found in clean ones."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from evsdr.fitting.simulation import simulate
from evsdr.viewing.check import DOUBTFUL, FINE, OPEN, WRONG, verdict
from evsdr.viewing.checks import examine
from evsdr.viewing.look import look_at
from tests.support.setups import scene_of
from tests.support.watched_files import PIXEL, ball_signal, lamp_recording, recorded, watched


@cache
def ball():
    return recorded()


def answers(file):
    return {check.name: check for check in examine(look_at(file))}


def odd(found):
    """List what is doubtful or wrong."""
    return {name: check.state for name, check in found.items() if check.state in (DOUBTFUL, WRONG)}


# ---------------------------------------------------------------------- nothing wrong


@pytest.mark.parametrize("triggers", [True, False])
@pytest.mark.parametrize("slot_us", [20_000.0, 5_000.0])
def test_a_clean_ball_is_good(slot_us, triggers):
    found = answers(watched(recorded(slot_us=slot_us), triggers))
    assert odd(found) == {}
    assert verdict(list(found.values())) == "good"
    assert {found[name].state for name in ("schedule", "LEDs", "room light", "saturation")} == {FINE}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["sphere", "blob", "colorchecker"])
def test_clean_scenes_are_good(name):
    assert odd(answers(watched(simulate(scene_of(name), rounds=4)[0]))) == {}


# ---------------------------------------------------------------------- one fault


@pytest.mark.parametrize("led", [0, 5])
def test_a_dead_led(led):
    signal = ball_signal().copy()
    signal[led] = 0
    found = answers(watched(recorded(signal)))
    assert odd(found) == {"LEDs": DOUBTFUL}
    assert f"LED {led} gives no light" in str(found["LEDs"])


@pytest.mark.parametrize("slot_us", [20_000.0, 10_000.0])
@pytest.mark.parametrize("hz", [100.0, 120.0])
def test_a_lamp_on_the_mains(hz, slot_us):
    found = answers(watched(lamp_recording(hz, slot_us)))
    assert odd(found) == {"room light": DOUBTFUL}
    assert f"keep time with {hz:g} Hz" in str(found["room light"])


def test_pixels_that_cannot_keep_up():
    found = answers(watched(recorded(slot_us=5_000.0, pixel=replace(PIXEL, refractory_us=2_000.0))))
    assert odd(found) == {"saturation": DOUBTFUL}


@pytest.mark.parametrize("triggers", [True, False])
@pytest.mark.parametrize("factor", [0.1, 0.5, 1.05, 2.0, 10.0])
def test_slots_of_another_length(factor, triggers):
    found = answers(watched(ball(), triggers, slot_us=20_000 * factor))
    assert odd(found) == {"schedule": WRONG}
    assert float(found["schedule"].remedy.split()[3].rstrip(",")) == pytest.approx(20_000, rel=1e-3)


def test_rounds_that_start_elsewhere():
    found = answers(watched(ball(), False, start_us=-6_000.0))
    assert odd(found) == {"schedule": WRONG}
    assert "don't start when they should" in str(found["schedule"])


@pytest.mark.parametrize(
    "drop, words", [(2, "the start of round 3 has none"), (0, "count for nothing"), (4, "count for nothing")]
)
def test_a_missing_trigger(drop, words):
    starts = np.delete(ball().round_start_us, drop)
    found = answers(watched(replace(ball(), round_start_us=starts)))
    assert odd(found) == {"triggers": DOUBTFUL}
    assert words in str(found["triggers"])


def test_a_trigger_too_many():
    starts = np.sort(np.append(ball().round_start_us, 300_000))
    found = answers(watched(replace(ball(), round_start_us=starts)))
    assert odd(found) == {"triggers": DOUBTFUL}
    assert "1 start no round (at 0.3" in str(found["triggers"])


def test_hard_switches():
    found = answers(watched(recorded(crossfade=0.0)))
    assert odd(found)["events"] == DOUBTFUL
    assert found["schedule"].state == found["LEDs"].state == FINE
    assert "hard switches lose events" in str(found["events"])


def test_hot_pixels():
    found = answers(watched(recorded(pixel=replace(PIXEL, hot_fraction=0.02, hot_hz=1000.0))))
    assert odd(found) == {"hot and silent pixels": DOUBTFUL}


def test_no_round_in_the_recording():
    found = answers(watched(ball(), False, start_us=1e7))
    assert odd(found) == {"schedule": WRONG}
    assert "Not one round" in str(found["schedule"])


def test_a_single_trigger_starts_the_rounds():
    recording = replace(ball(), round_start_us=ball().round_start_us[:1])
    assert odd(answers(watched(recording, start_us=-9_000.0))) == {}


def test_without_a_schedule_little_is_told():
    found = answers(replace(watched(ball()), schedule=None))
    assert odd(found) == {}
    assert {n for n, c in found.items() if c.state == OPEN} >= {"schedule", "LEDs", "room light", "scene"}
    assert "come again every 240 ms" in str(found["schedule"])
    one = replace(ball(), round_start_us=ball().round_start_us[:1])
    assert "has one trigger" in str(answers(replace(watched(one), schedule=None))["triggers"])
