"""When maps are made."""

from dataclasses import replace

import numpy as np
import pytest

from evsdr.errors import InputError
from evsdr.preview import replay as module
from evsdr.preview.replay import replay, times
from tests.support.preview_ball import ball_light, ball_recording
from tests.support.watched_files import N_LED

ROUND_US = 20_000 * N_LED


def test_maps_from_the_first_whole_round_to_the_end():
    np.testing.assert_allclose(times(ball_recording(), 1.0, 10.0), np.arange(2.2e5, 7.3e5, 1e5)[:5] + 1e5)
    np.testing.assert_allclose(times(ball_recording(), 3.0, 10.0), [3 * ROUND_US])
    no_triggers = replace(ball_recording(), round_start_us=np.empty(0, np.int64))
    assert times(no_triggers, 1.0, 10.0)[-1] == no_triggers.events.t[-1] + 1


def test_too_short():
    with pytest.raises(InputError, match="--rounds 4"):
        times(ball_recording(), 4.0, 10.0)


def test_late_maps_are_left_out_but_the_last(monkeypatch):
    now, costs = [0.0], iter([0.25, 0.0, 0.0, 0.25])
    monkeypatch.setattr(module.time, "perf_counter", lambda: now[0])

    def sleep(seconds):
        now[0] += seconds

    def decoder(window):
        now[0] += next(costs, 0.0)
        return None, None

    told = ball_recording(), decoder, ball_light().mask, 1.0, 1e5 * np.arange(3, 9)
    frames = list(replay(*told, True, sleep))
    assert [frame.end_us for frame in frames] == [3e5, 5e5, 6e5, 7e5, 8e5]
    assert frames[0].seconds == 0.25
    np.testing.assert_allclose(now[0], 0.65)
    assert len(list(replay(*told, False, sleep))) == 6
