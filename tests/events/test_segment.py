"""Light and photoreceptor in closed forms, and the search for crossings in them."""

import numpy as np
import pytest

from evsdr.events.pixel_kernel import Model
from evsdr.events.segment import (
    N_TERM,
    _growth_then,
    late_after,
    bounds,
    free_time,
    look,
    new_segment,
    next_crossing,
    own_time,
    x_at,
)


def segment_of(length, slope, transient=0.0, late=0.1, rise_us=0.0, cutoff=0.02, now=0.5):
    """Give a segment, its polynomial, and v and its own time in small steps of x, after each of 1/5 of it."""
    poly = np.zeros(N_TERM + 1)
    model = Model(1, 1.0, 1.0, rise_us, 1 / rise_us if rise_us else 0.0, cutoff, 0.0, 0.0, 0.0)
    segment = new_segment(length, now, slope, transient, np.log(now) - late, late, model, poly)
    n = 20_000
    x = (np.arange(n) + 0.5) * length / n
    light = now - transient + slope * x + (transient * np.exp(-x / rise_us) if rise_us else 0.0)
    v, out = np.log(now) - late, []
    for value in light:
        own = cutoff * value * length / n
        v = np.log(value) + (v - np.log(value)) * np.exp(-own)
        out.append(v)
    return (
        segment,
        poly,
        np.array(out)[n // 5 - 1 :: n // 5],
        np.cumsum(cutoff * light * length / n)[n // 5 - 1 :: n // 5],
    )


@pytest.mark.parametrize("late", [0.1, -2.0])
@pytest.mark.parametrize(
    "length, slope, transient, rise_us",
    [(300, 3e-4, 0, 0), (300, -3e-4, 0, 0), (10, 9e-3, 0, 0), (40, 5.2e-3, 0, 0), (200, -7e-4, 0, 0), (400, 0, 0, 0), (20, 1e-3, 0.1, 40), (100, 1e-4, -0.1, 200), (160, 1e-4, 5e-7, 40)],
)  # fmt: skip
def test_the_photoreceptor_answers(length, slope, transient, rise_us, late):
    """dv/ds = log I - v in small steps, short and long against tau; its rate; and x at its own time."""
    segment, poly, values, own = segment_of(float(length), slope, transient, late, rise_us)
    assert (own[-1] < 0.5) == (length < 50)
    for k in range(5):
        value, rate = look(own[k], segment, poly)
        assert value == pytest.approx(values[k], abs=5e-7)
        assert rate == pytest.approx((look(own[k] + 1e-4, segment, poly)[0] - value) / 1e-4, abs=2e-4)
        x = (k + 1) * length / 5
        assert x_at(own[k], segment) == pytest.approx(x, rel=1e-6)
        assert own_time(x, segment) == pytest.approx(own[k], rel=1e-7)


@pytest.mark.parametrize("slope", [2e-6, -2e-6, 0.0])
def test_the_lateness_after_a_long_fade(slope):
    """The series agrees with segments one after the other; where it would not do, there is no answer."""
    length, now, late, poly = 50_000.0, 0.5, 0.3, np.zeros(N_TERM + 1)
    model = Model(1, 1.0, 1.0, 0.0, 0.0, 0.02, 0.0, 0.0, 0.0)
    found = late_after(0.02 * length * (now + 0.5 * slope * length), late, slope, now + slope * length, 0.02)
    for _ in range(25):
        segment = new_segment(length / 25, now, slope, 0.0, np.log(now) - late, late, model, poly)
        late, now = look(segment.span, segment, poly)[1], now + slope * length / 25
    assert found == pytest.approx(late, abs=1e-8)
    assert (abs(found) > 1e-9) == (slope != 0)
    assert np.isnan(late_after(10.0, 0.3, 2e-6, 0.5, 0.02)) and np.isnan(
        late_after(1e3, 0.3, 2e-3, 0.5, 0.02)
    )


@pytest.mark.parametrize("tilt", [0.0, 0.03])
@pytest.mark.parametrize("leak", [0.0, 1e-3])
def test_crossings_are_where_they_are(leak, tilt):
    """v falls after a jump of the light, and turns as this rises: levels on its way, just above and below the turn."""
    segment, poly, *_ = segment_of(300.0, 4e-4, late=-0.4)
    s = np.linspace(0, segment.span, 20_001)
    path = np.array([look(at, segment, poly)[0] + leak * x_at(at, segment) for at in s]) + tilt * s
    drift, (value, rate) = leak / (0.02 * 0.5), look(0.0, segment, poly)
    for low in (path[0] - 0.1, path.min() + 1e-7, path.min() - 1e-7):
        found, x, sign = next_crossing(
            0.0, 0.0, segment.span, value, rate, low, 9.0, 0.0, tilt, leak, drift, segment, poly
        )
        beyond = np.flatnonzero(path <= low)
        assert sign == -(len(beyond) > 0)
        expected = s[beyond[0]] if len(beyond) else segment.span
        assert found == pytest.approx(expected, abs=2e-4 * segment.span)
        assert x == pytest.approx(x_at(found, segment), rel=1e-9)
    given = tilt, leak, drift, segment, poly
    found = next_crossing(0.0, 0.0, segment.span, value, rate, -9.0, path[0], 0.0, *given)
    assert found == (0.0, 0.0, 1)
    assert _growth_then(0.0, segment) == pytest.approx(4e-4 / (0.02 * 0.25))


@pytest.mark.parametrize(
    "slope, transient, late, rise_us", [(4e-4, 0, -0.4, 0), (-4e-4, 0, -0.4, 0), (1e-3, -0.1, 0.2, 200)]
)
def test_bounds_of_the_rate(slope, transient, late, rise_us, rng):
    """No rate in between is beyond them, nor can v reach something in the time that is said to be free."""
    segment, poly, *_ = segment_of(100.0, slope, transient, late, rise_us)
    for _ in range(300):
        s, stop = np.sort(segment.span * rng.random(2) ** 2)
        path = np.array([look(at, segment, poly) for at in np.linspace(s, stop, 50)])
        slowest, fastest = bounds(s, stop, path[0, 1], 0.0, segment)
        assert slowest - 1e-6 <= path[:, 1].min() and path[:, 1].max() <= fastest + 1e-6
        gap = path[:, 0].max() - path[0, 0] + 0.03 * rng.standard_normal() * rng.random() ** 4
        free = free_time(gap, gap - path[-1, 0] + path[0, 0], slowest, fastest, stop - s)
        if gap <= 0:
            assert free == 0
        else:
            ahead = np.linspace(s, stop, 50) - s < free - 1e-9
            assert free > 0 and path[ahead, 0].max() <= path[0, 0] + gap + 1e-9


def test_time_that_is_free():
    """Until it could be reached; from the end back; for good where both meet, or where it only falls."""
    assert free_time(1.0, -1.0, 0.0, 0.5, 4.0) == pytest.approx(2)
    assert free_time(1.0, -1.0, 0.5, 2.0, 4.0) == pytest.approx(2)
    assert free_time(1.0, 0.5, -1.0, 1.0, 1.4) > 1.4 and free_time(
        1.0, 0.5, -1.0, 1.0, 1.55
    ) == pytest.approx(1)
    assert free_time(1.0, 3.0, -2.0, -0.1, 1.0) > 1
    assert free_time(0.0, 1.0, -1.0, 1.0, 1.0) == 0
