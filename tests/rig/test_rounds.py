"""Rounds of the ring in the trigger edges: found, mended or refused."""

import numpy as np
import pytest

from evsdr.errors import InputError, InputWarning
from evsdr.rig.camera_file import Edges
from evsdr.rig.log import parse_ring_log
from evsdr.rig.rounds import find_rounds
from tests.support.ring_log import LOG, N_ROUND, ROUND_US, STARTS, pulses


def together(*edges: Edges) -> Edges:
    return Edges(*(np.concatenate([getattr(e, name) for e in edges]) for name in ("p", "t", "id")))


def log(**changes):
    return parse_ring_log(LOG | changes)


def test_camera_clock_is_measured():
    starts = np.rint(7000 + 1.003 * ROUND_US * np.arange(N_ROUND + 1)).astype(np.int64)
    rounds = find_rounds(pulses(starts), log())
    np.testing.assert_array_equal(rounds.start_us, starts)
    assert (
        rounds.clock_ratio == pytest.approx(1.003, abs=1e-6)
        and rounds.jitter_us < 1
        and len(rounds) == N_ROUND
    )


def test_slow_drift_is_followed():
    """Over 400 rounds the clocks drift apart by a quarter of a round."""
    starts = np.cumsum(np.r_[7000, np.linspace(10_000, 10_012, 400)]).astype(np.int64)
    rounds = find_rounds(pulses(starts), log(rounds_done=400))
    np.testing.assert_array_equal(rounds.start_us, starts)


def test_far_clock_warns():
    with pytest.warns(InputWarning, match="a round takes 1.0200 times as long on the camera's clock"):
        find_rounds(pulses(7000 + 10_200 * np.arange(N_ROUND + 1)), log())


def test_missing_edge_is_interpolated():
    with pytest.warns(InputWarning, match="trigger input 0 lacks the start of round 3; it is put where"):
        rounds = find_rounds(pulses(np.delete(STARTS, 2)), log())
    np.testing.assert_array_equal(rounds.start_us, STARTS)


@pytest.mark.parametrize("at", [0, 3, N_ROUND])
def test_doubled_edge_is_left_out(at):
    starts = np.sort(np.r_[STARTS, STARTS[at] + 30])
    with pytest.warns(InputWarning, match=r"has 1 edges that start no round \(at 0\.0\d+ s\)"):
        rounds = find_rounds(pulses(starts, length=10), log())
    np.testing.assert_array_equal(rounds.start_us, STARTS)


def test_every_edge_doubled():
    starts = np.stack([STARTS, STARTS + 30], axis=1).ravel()
    with pytest.warns(InputWarning, match="has 6 edges that start no round"):
        rounds = find_rounds(pulses(starts, length=10), log())
    np.testing.assert_array_equal(rounds.start_us, STARTS)


def test_burst_of_edges_does_not_move_the_grid():
    burst = STARTS[2] + 40 * np.arange(1, 6)
    with pytest.warns(InputWarning, match="has 5 edges that start no round"):
        rounds = find_rounds(pulses(np.sort(np.r_[STARTS, burst]), length=10), log())
    np.testing.assert_array_equal(rounds.start_us, STARTS)


@pytest.mark.parametrize("round_us", [10_000, 480_000])
def test_edges_that_jitter_are_no_stray_ones(round_us, rng):
    """By 3 ms in rounds of 480 ms, by 300 us in those of 10 ms."""
    late = rng.normal(0, 3000 if round_us > 10_000 else 300, N_ROUND + 1).astype(np.int64)
    starts = 70_000 + round_us * np.arange(N_ROUND + 1) + late
    with pytest.warns(InputWarning, match=r"the round starts jitter by \d+ us on trigger input 0"):
        rounds = find_rounds(pulses(starts), log(slot_us=round_us / 4))
    np.testing.assert_array_equal(rounds.start_us, starts)
    assert rounds.jitter_us == pytest.approx(late.std(), rel=0.7)


def test_one_late_edge_is_put_where_others_say():
    late = STARTS + 400 * (np.arange(N_ROUND + 1) == 2)
    with pytest.warns(
        InputWarning, match="has 1 edges that start no round .at 0.027400 s.|lacks the start of round 3"
    ):
        rounds = find_rounds(pulses(late), log())
    np.testing.assert_array_equal(rounds.start_us, STARTS)


def test_stray_edge_is_left_out():
    with pytest.warns(InputWarning, match=r"has 2 edges that start no round \(at 0.001000 s, 0.031000 s\)"):
        rounds = find_rounds(pulses(np.sort(np.r_[1000, STARTS, 31_000])), log())
    np.testing.assert_array_equal(rounds.start_us, STARTS)


@pytest.mark.parametrize("kept", [slice(1, None), slice(None, -1)])
def test_lost_end_leaves_the_other_rounds(kept):
    with pytest.warns(InputWarning, match="lacks the first or the last edge; the 4 rounds between"):
        rounds = find_rounds(pulses(STARTS[kept]), log())
    np.testing.assert_array_equal(rounds.start_us, STARTS[kept])


def test_stopped_ring_gives_its_complete_rounds():
    with pytest.warns(
        InputWarning, match=r"the ring did not end its run \(watchdog\); its 3 complete rounds"
    ):
        rounds = find_rounds(pulses(STARTS[:5]), log(rounds_done=3, ended="watchdog"))
    np.testing.assert_array_equal(rounds.start_us, STARTS[:4])


def test_falling_edges_of_an_active_low_trigger():
    edges = pulses(STARTS, low=True)
    np.testing.assert_array_equal(find_rounds(edges, log(), "falling").start_us, STARTS)
    with pytest.warns(
        InputWarning, match="begin with a falling edge, 200 us before .* give --trigger-edge falling"
    ):
        rounds = find_rounds(edges, log())
    np.testing.assert_array_equal(rounds.start_us, STARTS + 200)


def test_slot_edges_on_another_input_are_told_apart():
    slots = pulses(np.arange(STARTS[0], STARTS[-1], 2500), trigger_id=1)
    edges = together(slots, pulses(STARTS, trigger_id=3))
    assert find_rounds(edges, log()).trigger_id == 3
    np.testing.assert_array_equal(find_rounds(edges, log(), trigger_id=3).start_us, STARTS)
    assert_refused("on trigger input 1 .* 2.5 ms apart", edges, trigger_id=1)
    assert_refused("no rising trigger edge .* input 1: 20, input 3: 6; others: 26", edges, trigger_id=2)
    twice = together(pulses(STARTS, trigger_id=2), pulses(STARTS, trigger_id=3))
    assert_refused("rising edges on several inputs .input 2: 6, input 3: 6.; give --trigger-id", twice)


@pytest.mark.parametrize(
    "starts, sentence",
    [
        ([], "it holds no trigger edges"),
        ([5000], "one edge was seen"),
        (STARTS[:4], "saw 3 rounds from 0.007 s to 0.037 s but the ring made 5"),
        (np.arange(7) * ROUND_US, "saw 6 rounds .* but the ring made 5"),
        (
            STARTS * 2,
            "a round of the ring takes 10 ms but on trigger input 0 the rising edges are 20 ms apart",
        ),
        (np.delete(STARTS, [0, 2]), "saw 4 rounds"),
        (np.sort(np.r_[STARTS, 48_000 + 500 * np.arange(11)]), "has 11 edges too many"),
        (STARTS[[0, 1, 5]], "0 edges too many and 3 too few"),
    ],
)
def test_wrong_edges_are_refused(starts, sentence):
    assert_refused(sentence, pulses(starts))


def test_only_the_other_edge():
    edges = pulses(STARTS)
    falling = Edges(*(getattr(edges, name)[edges.p == 0] for name in ("p", "t", "id")))
    assert_refused(r"no rising trigger edge .*rising edges: none; others: 6.; check --trigger-id", falling)


def assert_refused(sentence, edges, **options):
    with pytest.raises(InputError, match=sentence) as caught:
        find_rounds(edges, log(), **options)
    assert str(caught.value).endswith(".") and "\n" not in str(caught.value)
