"""Words of EVT 3, put together by hand."""

import numpy as np

from evsdr.rig.raw import read_raw


def test_time_of_evt3_begins_with_its_high_part(tmp_path):
    """Words before the first time high are left out, and the time low starts over at a new time high."""
    early = [0x2025, 0x6005, 0x0001, 0x2002, 0x3001, 0x4001, 0xA001]  # the first looks like "% "
    words = np.array([*early, 0x8003, 0x2804, 0x6007, 0x2005, 0xA101, 0x8003, 0x2006, 0x8004, 0x2007], "<u2")
    path = tmp_path / "a.raw"
    path.write_bytes(b"% format EVT3;height=8;width=8\n% end\n" + words.tobytes())
    camera = read_raw(path)
    assert camera.events.t.tolist() == [3 << 12, 3 << 12 | 7, 3 << 12 | 7, 4 << 12]
    assert camera.events.x.tolist() == [4, 5, 6, 7] and camera.events.p.tolist() == [1, 0, 0, 0]
    assert (camera.edges.t.tolist(), camera.edges.id.tolist()) == ([3 << 12 | 7], [1])


def test_masks_of_evt3(tmp_path):
    words = np.array([0x8001, 0x6002, 0x0003, 0x3805, 0x4801, 0x5081, 0x4002], "<u2")
    path = tmp_path / "a.raw"
    path.write_bytes(b"% format EVT3;height=8;width=64\n% end\n" + words.tobytes())
    events = read_raw(path).events
    assert events.x.tolist() == [5, 16, 17, 24, 26]
    assert set(events.y) == {3} and set(events.p) == {1} and set(events.t) == {4098}
