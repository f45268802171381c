"""What speaks for a hypothesis, and whether it leaves no doubt."""

from types import SimpleNamespace

import numpy as np
import pytest

from evsdr.effects.evidence import Judge, Score, consistently_wrong
from evsdr.effects.hypotheses import Hypothesis
from evsdr.effects.trials import Trial


def test_thresholds_that_scatter_are_not_wrong(rng):
    scatter = np.exp(0.2 * rng.standard_normal((200, 2)))
    assert not consistently_wrong(scatter)
    assert consistently_wrong(2 * scatter) and consistently_wrong([1.0, 0.5] * scatter)
    assert not consistently_wrong(1.3 * scatter)
    assert not consistently_wrong(1.6 * scatter**2)


def test_what_a_pixel_tells_is_the_gain_of_all_its_events():
    """Gains of the events below a slip count for nothing; normals add theirs."""
    trial = SimpleNamespace(residual=np.zeros(60), place=np.zeros(3))
    assert Score(trial, events=0.019).total == 0
    assert Score(trial, events=0.12, shape=1.0, curl=-0.5).total == pytest.approx(20 * 0.1 + 0.5)
    assert Score(trial, events=-0.12).total == pytest.approx(-2.0)


@pytest.mark.parametrize(("left", "convicts"), [(0.03, True), (0.32, False)])
def test_half_of_a_curl_that_is_most_of_the_bends_convicts_no_one(left, convicts):
    judge = object.__new__(Judge)
    judge.doubts = SimpleNamespace(shape=False, curl=True)
    judge.told = Score(SimpleNamespace(scale=0.3, gain=None), curl_share=0.65)
    trial = SimpleNamespace(scale=0.3, gain=None, lost=0.5)
    assert bool(judge.convicts(Score(trial, curl=1.3, curl_share=left))) == convicts


@pytest.mark.parametrize(("n", "convicts"), [(2, False), (60, True), (80, True), (120, True)])
def test_a_hypothesis_that_leaves_hardly_any_events_explains_none(n, convicts):
    """As times in ns do, of which a round is longer than all of the recording."""
    judge, bends = object.__new__(Judge), SimpleNamespace(curl=lambda *_: 0.1)
    judge.shape, judge.n_unknown = None, 7
    judge.doubts = SimpleNamespace(bends=bends, shape=False, curl=False)
    normal = np.tile([0.0, 0.0, 1.0], (4, 1)) + np.random.default_rng(0).normal(size=(4, 3))
    judge.told = Score(Trial(0.0, 0.5, np.ones(64), np.arange(4), normal, None), curl_share=0.1)
    score = judge.score(Hypothesis("", "", None), Trial(-2.0, 0.02, np.zeros(n), np.arange(4), normal, None))
    assert score.lost == pytest.approx(max(1 - n / 64, 0))
    assert bool(judge.convicts(score)) == convicts


@pytest.mark.parametrize(("n_unknown", "convicts"), [(7, True), (8, False), (12, False)])
def test_what_explains_hardly_more_events_than_there_are_unknowns_convicts_no_one(n_unknown, convicts):
    judge, normal = object.__new__(Judge), np.tile([0.0, 0.0, 1.0], (4, 1))
    judge.doubts, judge.n_unknown = SimpleNamespace(shape=False, curl=False), n_unknown
    judge.told = Score(Trial(0.0, 0.08, np.ones(64), np.arange(4), normal, None))
    trial = Trial(-1.0, 0.02, np.zeros(64), np.arange(4), normal, None)
    assert bool(judge.convicts(Score(trial, 1.0))) == convicts
