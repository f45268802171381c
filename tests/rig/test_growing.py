"""A file that grows: in pieces, whatever they are, it gives what a reader of the whole gives."""

import numpy as np
import pytest

from evsdr.rig.growing import Growing
from evsdr.rig.raw import read_raw
from tests.support.camera_files import encode_raw, make_recording, random_recording


def pieces(path, data, sizes):
    """Write a file piece by piece; give what was read after each."""
    growing = Growing(path)
    found, at = [growing.take()], 0
    with open(path, "wb", buffering=0) as file:
        for size in sizes:
            file.write(data[at : at + size])
            at += size
            found.append(growing.take())
    growing.close()
    assert growing.trouble == ""
    return [piece for piece in found if piece is not None]


def joined(found, part, name):
    return np.concatenate([getattr(getattr(piece, part), name) for piece in found])


@pytest.mark.parametrize("kind", ["EVT2", "EVT21", "EVT21 legacy", "EVT3"])
def test_pieces_make_the_whole(kind, rng, tmp_path):
    """But for the end, which lies behind the last word of time; EVT 3.0's clock runs over twice."""
    data = encode_raw(random_recording(rng, 3000, 40, 40_000_000, 5_000_000), kind)
    sizes = [int(n) for n in rng.integers(1, 3000, 60)]
    (tmp_path / "whole.raw").write_bytes(data)
    whole = read_raw(tmp_path / "whole.raw")
    found = pieces(tmp_path / "grown.raw", data, [*sizes, len(data)])
    assert len(found) > 10 and (found[0].width, found[0].height) == (whole.width, whole.height)
    for part, names in (("events", "xypt"), ("edges", ("p", "t", "id"))):
        for name in names:
            got, expected = joined(found, part, name), getattr(getattr(whole, part), name)
            assert len(got) > 0.98 * len(expected)
            np.testing.assert_array_equal(got, expected[: len(got)], name)


def test_a_time_high_that_comes_again_does_not_take_the_time_back(tmp_path):
    """Cameras repeat it; a piece that starts there goes on at the time, and in the row, before."""
    words = [0x8001, 0x6005, 0x0007, 0x2003, 0x8001, 0x2004, 0x8001, 0x2005, 0x8002, 0x2006, 0x8003]
    data = b"% format EVT3;height=48;width=64\n% end\n" + np.array(words, "<u2").tobytes()
    found = pieces(tmp_path / "a.raw", data, [len(data) - 12, 2, 2, 2, 2, 2, 2])
    assert joined(found, "events", "t").tolist() == [0x1005, 0x1005, 0x1005, 0x2000]
    assert joined(found, "events", "y").tolist() == [7] * 4


def test_of_too_much_the_newest_is_read(rng, tmp_path):
    path = tmp_path / "a.raw"
    growing = Growing(path, most_bytes=2000)
    t = np.arange(5000) * 100
    path.write_bytes(encode_raw(make_recording(t % 64, t % 48, t % 2, t), "EVT2"))
    found = growing.take()
    assert 0.9 * t[-1] < found.events.t[0] <= found.events.t[-1] <= t[-1]
    assert growing.skipped > 0.9 * path.stat().st_size
    growing.close()


def test_an_older_recording_does_not_count(rng, tmp_path):
    path, data = tmp_path / "a.raw", encode_raw(random_recording(rng, 500, 4), "EVT3")
    path.write_bytes(data)
    growing = Growing(path)
    assert growing.take() is None
    path.with_name("b.raw").write_bytes(data)
    path.with_name("b.raw").replace(path)
    assert len(growing.take().events) > 400
    growing.close()


def test_what_is_no_recording_is_told_and_looked_at_again(rng, tmp_path):
    path = tmp_path / "a.raw"
    growing = Growing(path)
    path.write_bytes(b"% format EVT3;hei")
    assert growing.take() is None and "its header has no end" in growing.trouble
    path.write_bytes(encode_raw(random_recording(rng, 500, 4), "EVT3"))
    assert growing.take() is not None and growing.trouble == ""
    growing.close()
