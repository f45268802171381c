"""HDF5 files that others wrote: links, storage elsewhere, lengths beyond the file, damage."""

import os

import h5py
import numpy as np
import pytest

from evsdr.errors import InputError
from evsdr.files.events_h5 import read_recording, write_recording
from evsdr.files.hdf5 import member, open_hdf5, read_all
from tests.support.recording_file import small_recording


@pytest.fixture
def path(tmp_path):
    write_recording(tmp_path / "events.h5", small_recording())
    return tmp_path / "events.h5"


def read(path, name):
    with open_hdf5(path, "it") as file:
        return read_all(member(file, name))


def test_members_and_their_values(path):
    with open_hdf5(path, "it") as file:
        assert member(file, "CD/events").shape == (len(small_recording().events),)
        assert member(file, "schedule") == file["schedule"]
        for name in ("no", "CD/no", "CD/events/no", "no/no"):
            assert member(file, name) is None
    np.testing.assert_array_equal(read(path, "schedule/order"), small_recording().schedule.order)


@pytest.mark.parametrize("name", ["CD", "CD/events", "schedule/order", "sensor", "EXT_TRIGGER/events"])
def test_links_to_other_files_are_refused(path, tmp_path, name):
    write_recording(tmp_path / "other.h5", small_recording())
    with h5py.File(path, "r+") as file:
        if name in file:
            del file[name]
        file[name] = h5py.ExternalLink(str(tmp_path / "other.h5"), f"/{name}")
    with pytest.raises(InputError, match=f"{path}: {name}.* is a link to another file"):
        read_recording(path)


def test_links_within_a_file_are_followed(path):
    with h5py.File(path, "r+") as file:
        file.move("CD/events", "elsewhere")
        file["CD/events"] = h5py.SoftLink("/elsewhere")
    assert len(read_recording(path).events) == len(small_recording().events)


def test_values_in_other_files_are_refused(path, tmp_path):
    (tmp_path / "raw").write_bytes(np.arange(8, dtype="<i4").tobytes())
    with h5py.File(path, "r+") as file:
        del file["schedule/order"]
        file.create_dataset("schedule/order", (8,), "<i4", external=[(str(tmp_path / "raw"), 0, 32)])
    with pytest.raises(InputError, match="the values of schedule/order lie in other files"):
        read_recording(path)
    with h5py.File(path, "r+") as file:
        del file["schedule/order"]
        layout = h5py.VirtualLayout((8,), "<i4")
        layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "a", (8,))
        file.create_virtual_dataset("schedule/order", layout)
    with pytest.raises(InputError, match="the values of schedule/order lie in other files"):
        read_recording(path)


def test_lengths_beyond_the_file_are_refused(path):
    with h5py.File(path, "r+") as file:
        file["CD/events"].resize((2**31,))
    with pytest.raises(InputError, match="CD/events declares 2147483648 entries, but the file has only"):
        read_recording(path)


def test_arrays_beyond_the_memory_are_refused(path, monkeypatch):
    monkeypatch.setattr("evsdr.errors.free_memory", lambda: 100.0)
    with pytest.raises(InputError, match="events.h5: .* would need .* cut the recording"):
        read_recording(path)


def test_what_is_no_hdf5_is_said(tmp_path):
    (tmp_path / "a.h5").write_bytes(b"hello")
    for name, says in (("no.h5", "no such file; name it"), ("a.h5", "not a readable HDF5 file; name it")):
        with pytest.raises(InputError, match=says), open_hdf5(tmp_path / name, "it"):
            pass


def test_a_fifo_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "fifo")
    with pytest.raises(InputError, match="not a readable HDF5 file"), open_hdf5(tmp_path / "fifo", "it"):
        pass


@pytest.mark.filterwarnings("ignore::evsdr.errors.InputWarning")
def test_damage_is_said_in_one_sentence(path):
    """Some bytes of the file's structure, one by one."""
    data = path.read_bytes()
    refused = 0
    for at in range(0, 2000, 24):
        path.write_bytes(data[:at] + bytes([data[at] ^ 255]) + data[at + 1 :])
        try:
            read_recording(path)
        except InputError as error:
            refused += 1
            assert str(error).startswith(f"{path}: ") and str(error).count(f"{path}: ") == 1
    assert refused > 7


@pytest.mark.parametrize("at", [24, 48])
def test_texts_that_libhdf5_reads_for_ever(path, monkeypatch, at):
    """A size of zero in the heap of texts: the library looks for the heap's end without moving on."""
    monkeypatch.setattr("evsdr.files.hdf5.PATIENCE", 0.5)
    with h5py.File(path, "r+") as file:
        file.attrs["geometry"] = "12x12"
    data = bytearray(path.read_bytes())
    data[data.index(b"GCOL") + at] = 0
    path.write_bytes(data)
    with pytest.raises(InputError, match="events.h5: the HDF5 file is damaged or cut short; copy it again."):
        read_recording(path)
