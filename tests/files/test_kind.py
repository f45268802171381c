"""Content tells the kind of a file."""

import os
import threading

import numpy as np
import pytest

from evsdr.errors import InputError
from evsdr.files.arrays import read_npy, read_npz
from evsdr.files.events_h5 import read_recording, write_recording
from evsdr.files.json_text import read_json
from evsdr.files.kind import kind_of, other_kind
from evsdr.files.numbers import read_numbers
from evsdr.light.scene import load_scene
from tests.support.recording_file import small_recording
from tests.support.small_scene import scene


@pytest.fixture
def folder(tmp_path):
    """One file of each kind, all of one name."""
    for name in ("h5", "npz", "npy", "raw", "xz", "xml", "json", "other", "empty"):
        (tmp_path / name).mkdir()
    write_recording(tmp_path / "h5" / "a", small_recording())
    with open(tmp_path / "npz" / "a", "wb") as file:
        np.savez(file, a=np.arange(2))
    with open(tmp_path / "npy" / "a", "wb") as file:
        np.save(file, np.arange(2))
    (tmp_path / "raw" / "a").write_bytes(b"% evt 3.0\n% end\n\x00\x80")
    (tmp_path / "xz" / "a").write_bytes(b"\xfd7zXZ\x00\x00")
    (tmp_path / "xml" / "a").write_text("\ufeff\n" + scene(), encoding="utf-8")
    (tmp_path / "json" / "a").write_text('{"a": 1}')
    (tmp_path / "other" / "a").write_bytes(b"hello")
    (tmp_path / "empty" / "a").write_bytes(b"")
    return tmp_path


KINDS = {
    "h5": "HDF5, as a recording is",
    "xz": "a xz file, as EventPS publishes recordings",
    "npz": "an archive, as truth.npz and maps.npz are",
    "npy": "an array of NumPy",
    "raw": "a camera's RAW file",
    "xml": "XML, as a scene is",
    "json": "JSON, as ring.json is",
    "other": None,
    "empty": None,
    "missing": None,
}


@pytest.mark.parametrize("name", KINDS)
def test_kinds(folder, name):
    path = folder / name / "a"
    assert kind_of(path) == KINDS[name]
    assert other_kind(path, KINDS[name], "it") == ""
    assert other_kind(path, "", "it").endswith(
        "; name it." if KINDS[name] and name not in ("raw", "xz") else "convert." * bool(KINDS[name])
    )


def test_a_folder_is_none(folder):
    assert (
        other_kind(folder, "", "an events.h5 in it")
        == f"{folder}: this is a folder; name an events.h5 in it."
    )


@pytest.mark.parametrize("name", ["npz", "npy", "raw", "xml", "json"])
def test_a_recording_of_another_kind_is_named(folder, name):
    path = folder / name / "a"
    with pytest.raises(InputError) as caught:
        read_recording(path)
    remedy = (
        "join it with the ring's log by python -m evsdr.convert" if name == "raw" else "name an events.h5"
    )
    assert str(caught.value) == f"{path}: this is {KINDS[name]}; {remedy}."


@pytest.mark.parametrize("name", ["h5", "npz", "raw", "json"])
def test_a_scene_of_another_kind_is_named(folder, name):
    path = folder / name / "a"
    with pytest.raises(InputError, match=f"this is {KINDS[name]}; "):
        load_scene(path)
    with pytest.raises(InputError, match="this is a folder; name a scene.xml"):
        load_scene(folder)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs FIFOs")
@pytest.mark.parametrize(
    "read",
    [
        lambda path: read_npz(path, ("a",), "it"),
        lambda path: read_npy(path, "it"),
        lambda path: read_json(path, "it"),
        lambda path: read_numbers(path, "it"),
        read_recording,
        load_scene,
    ],
)
def test_no_reader_waits_for_a_fifo(tmp_path, read):
    """In a thread, as a reader that opens it would wait for ever."""
    os.mkfifo(tmp_path / "fifo")
    caught = []

    def work():
        try:
            read(tmp_path / "fifo")
        except InputError as error:
            caught.append(error)

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    thread.join(20)
    assert len(caught) == 1
