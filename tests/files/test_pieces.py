"""Lists of records come piece by piece, however they are stored, and equal what h5py reads in one."""

import zlib

import h5py
import numpy as np
import pytest

from evsdr.errors import InputError
from evsdr.files import pieces
from evsdr.files.events_h5 import EVENT_DTYPE, read_recording, write_recording
from tests.support.recording_file import change, small_recording

N = 2500
STORED = {
    "plain": dict(),
    "deflated": dict(chunks=(700,), compression="gzip"),
    "shuffled": dict(chunks=(700,), compression="gzip", shuffle=True),
    "shuffled, in small chunks": dict(chunks=(90,), compression="gzip", shuffle=True),
    "checked": dict(chunks=(700,), compression="gzip", shuffle=True, fletcher32=True),
}
OTHER = np.dtype({"names": ["t", "x", "y", "p"], "formats": [">i4", "<u4", "<i2", "?"]})


@pytest.fixture(autouse=True)
def _small_pieces(monkeypatch):
    monkeypatch.setattr(pieces, "PIECE", 300)


def read(path):
    found = {}
    with h5py.File(path) as file:
        pieces.for_pieces(file["a"], lambda begin, columns: found.update({begin: columns}))
    return {name: np.concatenate([found[k][name] for k in sorted(found)]) for name in found[0]}


@pytest.mark.parametrize("dtype", [EVENT_DTYPE, OTHER], ids=["usual", "other"])
@pytest.mark.parametrize("stored", STORED.values(), ids=STORED)
def test_pieces_are_the_whole(tmp_path, rng, stored, dtype):
    table = np.zeros(N, dtype)
    for name in dtype.names:
        table[name] = rng.integers(0, 2 if name == "p" else 30_000, N)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("a", data=table, **stored)
    columns = read(tmp_path / "a.h5")
    for name in dtype.names:
        np.testing.assert_array_equal(columns[name], table[name], name)


def test_chunks_that_are_not_there_and_those_stored_unpacked(tmp_path):
    whole = np.ones(700, EVENT_DTYPE)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        dataset = file.create_dataset("a", 1400, EVENT_DTYPE, **STORED["shuffled"])
        dataset.id.write_direct_chunk((700,), whole.tobytes(), filter_mask=3)
    assert read(tmp_path / "a.h5")["x"].tolist() == [0] * 700 + [1] * 700


def test_damage_inside_a_chunk_is_no_event(tmp_path):
    """Whatever is in the way of inflating comes as an OSError, which a reader turns into a sentence."""
    for k, data in enumerate((b"no", zlib.compress(b"short"))):
        with h5py.File(tmp_path / f"{k}.h5", "w") as file:
            dataset = file.create_dataset("a", 700, EVENT_DTYPE, **STORED["shuffled"])
            dataset.id.write_direct_chunk((0,), data)
        with pytest.raises(OSError, match="chunk 0"):
            read(tmp_path / f"{k}.h5")


def test_time_that_runs_backwards_between_pieces_is_refused(tmp_path):
    path = tmp_path / "events.h5"
    write_recording(path, small_recording())
    change(path, "CD/events", lambda table: np.concatenate([table[200:], table[:200]]))  # pieces of 300
    with pytest.raises(InputError, match="t of CD/events runs backwards at event 300;"):
        read_recording(path)
