"""Chunks of ECF: known bytes, and bytes that are cut or noise."""

import numpy as np
import pytest

from evsdr.files.events_h5 import EVENT_DTYPE
from evsdr.rig import ecf
from tests.support.camera_files import (
    encode_ecf,
    random_recording,
)


@pytest.fixture
def camera(rng):
    return random_recording(rng, n_event=5500, n_edge=7, duration_us=2_000_000, start_us=2**40)


def test_known_bytes():
    """A chunk put together by hand from the format's description."""
    head = (3 << 2).to_bytes(4, "little") + (1000).to_bytes(8, "little")
    times = bytes([0x02, 0xF3, 0xF1, 0x21])  # two at 1000; 0x13 = 19 later and 2 more: one at 1021
    rows = (9 << 5 | 3).to_bytes(2, "little")
    columns = (20 << 5 | 0b01000).to_bytes(2, "little") + (30 << 5).to_bytes(2, "little")
    data = head + times + rows + columns + bytes([0x82, 0x01])
    x, y, p, t = (np.zeros(3 + ecf.SPARE, kind) for kind in ("u2", "u2", "i1", "i8"))
    assert ecf.decode_chunk(data, x, y, p, t) == 3
    assert (x[:3].tolist(), y[:3].tolist()) == ([20, 22, 30], [9, 9, 9])
    assert (p[:3].tolist(), t[:3].tolist()) == ([1, 1, 0], [1000, 1000, 1021])
    assert ecf.decode_chunk(data.replace(b"\xf1\x21", b"\xf1\x22"), x, y, p, t) == ecf.DAMAGED  # 4 times
    assert ecf.decode_chunk(b"\x0f" + data[1:], x, y, p, t) == ecf.DAMAGED  # an unknown style
    assert ecf.decode_chunk(data, *(a[:-1] for a in (x, y, p, t))) == ecf.DAMAGED  # no room


@pytest.mark.parametrize("style", [0, 1, 2])
def test_cut_and_noisy_chunks_end(rng, camera, style):
    """Whatever the bytes, the decoder stays inside its arrays and ends."""
    table = np.zeros(200, EVENT_DTYPE)
    for name in EVENT_DTYPE.names:
        table[name] = getattr(camera.events, name)[:200]
    data = encode_ecf(table, style)
    arrays = [np.zeros(200 + ecf.SPARE, kind) for kind in ("u2", "u2", "i1", "i8")]
    assert ecf.decode_chunk(data, *arrays) == 200
    assert all(ecf.decode_chunk(data[:size], *arrays) == ecf.DAMAGED for size in range(len(data) - 1))
    for _ in range(300):
        noise = data[:4] + rng.bytes(rng.integers(0, 600))
        assert ecf.decode_chunk(noise, *arrays) in (200, ecf.DAMAGED)
        assert ecf.decode_chunk(rng.bytes(200), *arrays) <= 200
