"""What a recording holds, for whoever does not know how the ring ran."""

from evsdr.rig.contents import rows
from tests.support.camera_files import make_recording
from tests.support.ring_log import ROUND_US, STARTS, pulses


def test_all_is_told():
    edges = pulses(STARTS, trigger_id=2)
    told = dict(
        rows(make_recording([1, 2, 2], [0, 0, 0], [0, 1, 1], [10, 20, 1_000_010], edges.p, edges.t, edges.id))
    )
    assert told["sensor"] == "64 x 48 pixels" and told["events"] == "3"
    assert told["ON events"] == "66.7%"
    assert told["trigger input 2, rising"] == f"6 from 0.007000 s, {1e-3 * ROUND_US:g} ms apart"
    assert told["trigger input 2, falling"].startswith("6 from 0.007200 s")
    assert dict(rows(make_recording([1, 2], [0, 0], [0, 1], [10, 20])))["triggers"] == "none"
