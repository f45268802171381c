"""The likelihood of watched pixels: its derivatives by the unknowns of a model, and what is learnt between steps."""

import numpy as np
import pytest

from evsdr.calibration.likelihood import SENSOR, first_belief, learnt, moved, sum_parts
from tests.support.watched_pixels import TRUTH, unknown_signals, watched


def shared_gain(x):
    """Signals with one more unknown that all LEDs share."""
    signal = np.exp(x[:3] + x[3])[:, None]
    return signal, signal[..., None], signal[..., None]


@pytest.fixture(params=[False, True], ids=["told", "own thresholds"])
def case(request):
    part = watched(one_value=request.param)
    x = np.concatenate([TRUTH + 0.02, [0.01], np.zeros(len(SENSOR))])
    return [part], first_belief([part], x, 0.05, 0.1)


def move(belief, step):
    return type(belief)(
        belief.x + step, *(getattr(belief, k) for k in ("scatter", "spread", "gains", "weigh", "heard"))
    )


def test_the_gradient_is_that_of_the_cost(case):
    """By signals, what they share, and mean thresholds; of pixels' own, the part that they don't follow."""
    parts, belief = case
    sums = sum_parts(parts, shared_gain, belief, ())
    if parts[0].own_thresholds:
        belief = type(belief)(*(getattr(belief, k) for k in ("x", "scatter", "spread")),
                              [belief.gains[0] + sums.rest[0]], belief.weigh, belief.heard)  # fmt: skip
        sums = sum_parts(parts, shared_gain, belief, ())
    which = [0, 1, 2, 3, *((-2, -1) if not parts[0].own_thresholds else ())]
    for k in which:
        step = np.zeros(len(belief.x))
        step[k] = 1e-5
        up, down = (sum_parts(parts, shared_gain, move(belief, s), ()) for s in (step, -step))
        expected = (up.cost.sum() - down.cost.sum()) / 2e-5
        slack = 0.02 * np.abs(sums.gradient).max() + (
            np.abs(sums.gradient).max() * 0.1 if parts[0].own_thresholds else 0
        )
        assert sums.gradient[k] == pytest.approx(expected, abs=slack), k
    np.testing.assert_allclose(sums.matrix, sums.matrix.T, rtol=1e-6, atol=1e-6 * np.abs(sums.matrix).max())


def test_own_thresholds_follow_a_step(case):
    parts, belief = case
    sums = sum_parts(parts, shared_gain, belief, ())
    step = np.zeros(len(belief.x))
    step[3] = 0.01
    new = moved(belief, step, sums, np.full(len(belief.x), -np.inf))
    if not parts[0].own_thresholds:
        assert not new.gains[0].any()
        return
    np.testing.assert_allclose(new.gains[0], sums.rest[0] + 0.01 * sums.response[0][:, :, 3])
    better = sum_parts(parts, shared_gain, new, ())
    assert better.cost.sum() < sums.cost.sum()


def test_a_step_goes_no_lower_than_the_least():
    part = watched()
    belief = first_belief([part], np.zeros(3 + len(SENSOR)), 0.05, 0.1)
    sums = sum_parts([part], unknown_signals, belief, ())
    new = moved(
        belief, np.full(len(belief.x), -1.0), sums, np.append(np.full(3, -np.inf), np.zeros(len(SENSOR)))
    )
    assert (new.x[:3] == -1).all() and not new.x[3:].any()


def test_scatter_is_learnt_and_pixels_that_disagree_are_not_heard():
    part = watched()
    noisy = part.events[3].copy()
    first = slice(part.events[0][7], part.events[0][8])
    noisy[first] *= -1  # one pixel with the wrong sign
    part = type(part)(**vars(part) | {"events": (*part.events[:3], noisy, *part.events[4:])})
    belief = first_belief([part], np.append(TRUTH, np.zeros(len(SENSOR))), 0.2, 0.1)
    known = learnt([part], belief, sum_parts([part], unknown_signals, belief, ()))
    assert known.scatter == pytest.approx(0.02, rel=0.2)
    assert list(np.flatnonzero(~known.heard[0])) == [7]
    assert not sum_parts([part], unknown_signals, known, ()).score[7].any()
