"""Events from real photographs, beside least squares on them; skips where the photographs are absent."""

import numpy as np
import pytest
from experiments.diligent_ball.compute import (
    fit_events,
    least_squares,
    order_with_pauses,
    read_ball,
    rim_order,
)

from evsdr.metrics import angular_error_deg


@pytest.fixture(scope="module")
def ball():
    from experiments.diligent_ball.compute import data_path

    if not data_path().is_file():
        pytest.skip(f"{data_path()} is absent")
    return read_ball(data_path())


def mean_error(ball, normal):
    return angular_error_deg(normal, ball.normal)[ball.mask].mean()


def test_the_frame_of_the_photographs_is_ours(ball):
    """Row 0 is the top, so the upper half faces up; least squares on all lights has its known error."""
    rows = np.nonzero(ball.mask)[0]
    assert ball.normal[ball.mask][rows < np.median(rows)][:, 1].mean() > 0.3
    normal, _ = least_squares(ball.signal, ball.light_direction)
    assert mean_error(ball, normal) == pytest.approx(4.29, abs=0.02)


def test_the_rim_is_a_ring_in_order_of_azimuth(ball):
    light = ball.light_direction[rim_order(ball.light_direction)]
    azimuth = np.degrees(np.arctan2(light[:, 1], light[:, 0]))
    assert 30 <= len(light) <= 40
    assert np.diff(azimuth).min() > 0
    assert np.diff(azimuth).max() < 20


@pytest.mark.slow
def test_events_beat_least_squares_on_the_same_photographs(ball, tmp_path):
    rim = rim_order(ball.light_direction)
    normal, _ = least_squares(ball.signal[rim], ball.light_direction[rim])
    maps, _ = fit_events(ball, tmp_path, order_with_pauses(len(rim)), ideal=False)
    assert mean_error(ball, maps.normal) < 2.6
    assert mean_error(ball, maps.normal) < 0.6 * mean_error(ball, normal)
