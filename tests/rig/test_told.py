"""A ring without a log: what is told of it, and what the triggers and events tell."""

import numpy as np
import pytest

from evsdr.errors import InputError
from evsdr.rig.told import ToldRing, complete
from tests.support.camera_files import make_recording
from tests.support.ring_log import N_ROUND, ORDER, ROUND_US, SLOT_US, STARTS, pulses


def recording(edges=None, last=70_000):
    edges = (edges.p, edges.t, edges.id) if edges else ()
    return make_recording([1, 2], [1, 2], [0, 1], [100, last], *edges)


def test_triggers_tell_slots_and_rounds():
    log = complete(ToldRing(tuple(ORDER), crossfade=0.5), recording(pulses(STARTS)))
    assert (log.slot_us, log.n_round, log.crossfade, log.ended) == (SLOT_US, N_ROUND, 0.5, "done")
    np.testing.assert_array_equal(log.order, ORDER)
    assert complete(ToldRing(tuple(ORDER), n_round=3), recording(pulses(STARTS))).n_round == 3


def test_slots_and_a_start_tell_rounds_where_there_are_no_triggers():
    told = ToldRing(tuple(ORDER), slot_us=SLOT_US)
    assert complete(told, recording(), start_us=12_000.0).n_round == (70_000 - 12_000) // ROUND_US
    with pytest.raises(InputError, match="no round of 10 ms fits between 0.065 s and 0.070 s"):
        complete(told, recording(), start_us=65_000.0)
    with pytest.raises(InputError, match="it holds no trigger edges; .*--start-us"):
        complete(told, recording())
    with pytest.raises(InputError, match="give --slot-us"):
        complete(ToldRing(tuple(ORDER)), recording(), start_us=0.0)


def test_several_inputs_are_told_by_the_rounds():
    both = [pulses(STARTS), pulses(STARTS[:3] + 50, trigger_id=1)]
    edges = type(both[0])(*(np.concatenate([getattr(e, name) for e in both]) for name in ("p", "t", "id")))
    assert complete(ToldRing(tuple(ORDER), n_round=N_ROUND), recording(edges)).slot_us == SLOT_US
    with pytest.raises(InputError, match="give --trigger-id"):
        complete(ToldRing(tuple(ORDER)), recording(edges))
    with pytest.raises(InputError, match="a single trigger edge"):
        complete(ToldRing(tuple(ORDER)), recording(pulses(STARTS[:1])))


@pytest.mark.parametrize(
    "told, sentence",
    [
        ({"order": ()}, "--order must name"),
        ({"order": (-1, -1)}, "--order must name"),
        ({"order": (0, 256)}, "--order must name"),
        ({"slot_us": 0.0}, "--slot-us is 0"),
        ({"slot_us": float("nan")}, "--slot-us is nan"),
        ({"crossfade": 1.5}, "--crossfade is 1.5"),
        ({"n_round": 0}, "--rounds is 0"),
    ],
)
def test_what_can_not_be(told, sentence):
    with pytest.raises(InputError, match=sentence):
        ToldRing(**{"order": (0, 1)} | told)
