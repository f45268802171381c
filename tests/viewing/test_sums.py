"""What is kept of a recording that grows: the same in pieces as at once, and a picture of each LED that shows its light."""

from dataclasses import replace

import numpy as np
import pytest

from evsdr.viewing.sums import RATE_US, Sums
from tests.support.grown_files import as_camera, ball
from tests.support.watched_files import CONSTANT_LIGHT, SIZE, ball_signal


def summed(pieces, recording, size=SIZE):
    sums = Sums(recording.schedule, size, size)
    for piece in pieces:
        sums.add(piece)
    return sums


@pytest.fixture(scope="module")
def whole():
    return summed([as_camera(ball())], ball())


def test_pieces_make_the_same_sums(whole):
    knots = np.r_[-np.inf, np.linspace(0, 240_000, 23), np.inf]
    pieces = [as_camera(ball(), begin=a, end=b) for a, b in zip(knots, knots[1:])]
    sums = summed(pieces, ball())
    assert (sums.n_event, sums.n_round, sums.agree) == (whole.n_event, 4, whole.agree)
    np.testing.assert_array_equal(sums.per_slot, whole.per_slot)
    np.testing.assert_array_equal(sums.rate()[0], whole.rate()[0])
    np.testing.assert_allclose(sums.levels()[0], whole.levels()[0])


def test_levels_are_the_log_light_of_each_led(whole):
    """To a threshold or so: events tell no less."""
    level, seen = whole.levels()
    truth = np.log(ball_signal() + CONSTANT_LIGHT)
    truth = (truth - truth.mean(0))[:, seen] / ball().sensor.contrast_threshold_on[seen]
    assert seen.sum() > 0.5 * seen.size and not level[:, ~seen].any()
    assert np.corrcoef(level[:, seen].ravel(), truth.ravel())[0, 1] > 0.95
    assert np.sqrt(np.mean((level[:, seen] - truth) ** 2)) < 1


def test_events_over_time_are_counted(whole):
    (off, on), begin = whole.rate()
    t, p = ball().events.t, ball().events.p
    expected = [np.count_nonzero((t // RATE_US == k // RATE_US) & (p == 1)) for k in begin]
    assert on.tolist() == expected and (off + on).sum() == len(t) and np.all(np.diff(begin) == RATE_US)
    assert whole.per_slot.sum() == np.count_nonzero((t >= 180_000) & (t < 240_000))  # the last round


def test_a_large_sensor_is_shown_coarser():
    large = replace(ball(), events=replace(ball().events, x=16 * ball().events.x, y=16 * ball().events.y))
    camera = replace(as_camera(large), width=16 * SIZE, height=16 * SIZE)
    sums = summed([camera], large, 16 * SIZE)
    assert (sums.step, sums.width, sums.height) == (2, 160, 160) and sums.agree > 0.9
    level, seen = sums.levels()
    assert seen[::8, ::8].sum() == seen.sum() > 0.5 * SIZE**2


def test_without_triggers_there_are_no_rounds():
    sums = summed([as_camera(ball(), triggers=False)], ball())
    assert sums.triggers is None and sums.n_round == 0 and np.isnan(sums.agree)
