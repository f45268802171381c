"""RAW files of EVT 2.0, 2.1 and 3.0: own encoders are read back, real files match, faults are named."""

import numpy as np
import pytest

from evsdr.errors import InputError, InputWarning
from evsdr.rig.raw import read_raw
from tests.support.camera_files import TYPES, assert_same, encode_raw, random_recording

FORMATS = ["EVT2", "EVT21", "EVT21 legacy", "EVT3"]


@pytest.mark.parametrize("kind", FORMATS)
def test_round_trip(tmp_path, rng, kind):
    """Events in bursts, so that masks occur, over three overflows of EVT3's clock."""
    camera = random_recording(rng, 20_000, 50, duration_us=3 * 2**24, width=1280, height=720)
    path = tmp_path / "a.raw"
    path.write_bytes(encode_raw(camera, kind))
    assert_same(read_raw(path), camera)


@pytest.mark.parametrize("kind", FORMATS)
def test_blocks_go_on_where_the_last_ended(tmp_path, rng, kind, monkeypatch):
    """Rows, masks and times reach over the end of a block; events on disk are those in memory."""
    monkeypatch.setattr("evsdr.rig.raw.BLOCK", 7)
    monkeypatch.setattr("evsdr.files.scratch.SHARE", 0.0)
    camera = random_recording(rng, 600, 50, duration_us=3 * 2**24, width=1280, height=720)
    path = tmp_path / "a.raw"
    path.write_bytes(encode_raw(camera, kind).replace(b";endianness=legacy", b""))
    assert_same(read_raw(path), camera)


@pytest.mark.parametrize("kind", ["EVT2", "EVT21", "EVT21 legacy"])
def test_clock_of_34_bits_runs_over(tmp_path, rng, kind):
    camera = random_recording(rng, n_event=3000, n_edge=9, duration_us=4_000_000, start_us=2**34 - 2_000_000)
    path = tmp_path / "a.raw"
    path.write_bytes(encode_raw(camera, kind))
    assert camera.events.t[-1] > 2**34 > camera.events.t[0]
    assert_same(read_raw(path), camera)


@pytest.mark.parametrize("kind", ["EVT21", "EVT21 legacy"])
def test_order_of_halves_is_guessed(tmp_path, rng, kind):
    camera = random_recording(rng, n_event=5000, n_edge=9)
    path = tmp_path / "a.raw"
    data = encode_raw(camera, kind)
    assert b";endianness=" in data
    path.write_bytes(data.replace(b";endianness=legacy", b"").replace(b";endianness=little", b""))
    assert_same(read_raw(path), camera)


def test_header_without_end_and_size_by_hand(tmp_path):
    words = np.array([0x8001, 0x0003, 0x2005], "<u2").tobytes()
    path = tmp_path / "a.raw"
    path.write_bytes(b"% evt 3.0\n" + words)
    assert read_raw(path, (16, 8)).width == 16
    assert_refused(path, "header does not tell the sensor's size; give it by --sensor-size")
    path.write_bytes(b"% evt 3.0\n% geometry 16x8\n" + words)
    assert (read_raw(path).width, read_raw(path).height) == (16, 8)


def test_cut_last_word_warns(tmp_path, rng):
    camera = random_recording(rng, n_event=100, n_edge=2)
    path = tmp_path / "a.raw"
    path.write_bytes(encode_raw(camera, "EVT2") + b"\x01\x02\x03")
    with pytest.warns(InputWarning, match="its last word is cut short, so its last 3 bytes are left out"):
        assert_same(read_raw(path), camera)


def test_few_unknown_words_warn(tmp_path, rng):
    camera = random_recording(rng, n_event=4000, n_edge=2)
    path = tmp_path / "a.raw"
    path.write_bytes(encode_raw(camera, "EVT3") + b"\x00\xd0")
    with pytest.warns(InputWarning, match="1 of its words are unknown and left out"):
        assert_same(read_raw(path), camera)


def test_few_events_outside_are_left_out(tmp_path, rng):
    camera = random_recording(rng, n_event=1000, n_edge=2)
    stray = np.array([0x8 << 28 | 0xFFFF, 0x1 << 28 | camera.width << 11], "<u4").tobytes()
    path = tmp_path / "a.raw"
    path.write_bytes(encode_raw(camera, "EVT2") + stray)
    with pytest.warns(InputWarning, match="1 events outside the sensor of 64 x 48 pixels are left out"):
        assert_same(read_raw(path), camera)


def test_real_recordings(shared_data):
    """Figures of the payloads, as two independent decoders give them."""
    camera = read_real(shared_data / "evt3_real_640x480.raw")
    assert (len(camera.events), len(camera.edges)) == (343_474, 4157)
    assert set(camera.edges.id) == {6} and camera.edges.t[:3].tolist() == [7139840, 7140340, 7140840]
    camera = read_real(shared_data / "evt3_trigger_1280x720.raw")
    assert len(camera.events) == 82_469
    assert (camera.edges.p.tolist(), camera.edges.t.tolist()) == ([0, 1], [14547491, 14549491])
    assert camera.edges.id.tolist() == [0, 0]


@pytest.mark.parametrize("name", ["evt3_real_640x480.raw", "evt3_trigger_1280x720.raw"])
def test_real_recordings_as_by_package_evt3(shared_data, name):
    evt3 = pytest.importorskip("evt3")
    camera = read_real(shared_data / name)
    events, triggers = evt3.decode_file_with_triggers(str(shared_data / name))
    for ours, theirs in (("x", "x"), ("y", "y"), ("p", "p"), ("t", "t")):
        np.testing.assert_array_equal(getattr(camera.events, ours), getattr(events, theirs), ours)
    np.testing.assert_array_equal(camera.edges.t, triggers.timestamp)
    np.testing.assert_array_equal(camera.edges.p, triggers.value)
    np.testing.assert_array_equal(camera.edges.id, triggers.id)


def read_real(path):
    if not path.is_file():
        pytest.skip(f"no file {path}")
    size = path.stat().st_size - path.read_bytes().index(b"% end\n") - 6
    if size % 2:
        with pytest.warns(InputWarning, match="last word is cut short"):
            return read_raw(path)
    return read_raw(path)


HEADER = b"% format EVT3;height=480;width=640\n% end\n"


@pytest.mark.parametrize(
    "data, sentence",
    [
        (b"", "this is no RAW file"),
        (b"x,y,p,t\n1,2,1,5\n", "this is no RAW file"),
        (b"% format EVT3", "its header has no end"),
        (b"% date 2024-01-01\n% end\n" + bytes(100), "its header names no format"),
        (b"% format EVT4;height=8;width=8\n% end\n" + bytes(100), "its header names the format EVT4"),
        (b"% evt 9.0\n% end\n" + bytes(100), "its header names the format EVT 9.0"),
        (HEADER, "nothing follows its header"),
        (HEADER + b"\x01", "nothing follows its header"),
        (HEADER + np.arange(0x6000, 0x6400, dtype="<u2").tobytes(), "it holds no events"),
        (HEADER.replace(b"640", b"0"), "its header does not tell the sensor's size"),
        (b"% format EVT21;height=8;width=8;endianness=big\n% end\n" + bytes(80), "its byte order is big"),
    ],
)
def test_faults(tmp_path, data, sentence):
    path = tmp_path / "a.raw"
    path.write_bytes(data)
    assert_refused(path, sentence)


@pytest.mark.parametrize("kind", ["EVT2", "EVT21", "EVT3"])
def test_noise_is_refused(tmp_path, rng, kind):
    path = tmp_path / "a.raw"
    path.write_bytes(b"% format " + kind.encode() + b";height=480;width=640\n% end\n" + rng.bytes(80_000))
    assert_refused(path, rf"of its words are no {kind}, the format that its header names")


@pytest.mark.parametrize("told", ["EVT2", "EVT21", "EVT3"])
@pytest.mark.parametrize("kind", ["EVT2", "EVT21", "EVT21 legacy", "EVT3"])
def test_wrong_format_is_refused(tmp_path, rng, kind, told):
    if kind.startswith(told) and told != "EVT2" or kind == told:
        return
    camera = random_recording(rng, n_event=20_000, n_edge=9)
    _, _, words = encode_raw(camera, kind).partition(b"% end\n")
    path = tmp_path / "a.raw"
    path.write_bytes(f"% format {told};height=48;width=64\n% end\n".encode() + words)
    assert_refused(path, "of its words are no|lie outside the sensor")


def test_wrong_size_is_refused(tmp_path, rng):
    path = tmp_path / "a.raw"
    path.write_bytes(encode_raw(random_recording(rng, n_event=1000, n_edge=0), "EVT3"))
    with pytest.raises(InputError, match="lie outside the sensor of 32 x 48 pixels; give the true size"):
        read_raw(path, (32, 48))


def assert_refused(path, sentence):
    with pytest.raises(InputError, match=sentence) as caught:
        read_raw(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ") and message.endswith(".") and "\n" not in message


def test_types_of_the_encoders_differ():
    assert len(set(TYPES.values())) == len(TYPES)
