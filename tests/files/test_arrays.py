"""Archives and arrays of NumPy that others wrote."""

import zipfile

import numpy as np
import pytest

from evsdr.errors import InputError
from evsdr.files.arrays import read_npy, read_npz


def test_arrays_that_are_there_are_read(tmp_path):
    np.savez(tmp_path / "a.npz", a=np.arange(3), b=np.ones(2), c=0)
    found = read_npz(tmp_path / "a.npz", ("a", "b", "no"), "it")
    assert set(found) == {"a", "b"} and found["a"].tolist() == [0, 1, 2]
    np.save(tmp_path / "a.npy", np.eye(2))
    np.testing.assert_array_equal(read_npy(tmp_path / "a.npy", "it"), np.eye(2))


def test_a_member_that_is_no_array_is_said(tmp_path):
    """Renamed, so that it lacks its ending, it comes as bytes."""
    np.save(tmp_path / "a.npy", np.ones(3))
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as file:
        file.writestr("mask", (tmp_path / "a.npy").read_bytes()[10:])
    with pytest.raises(
        InputError, match="a.npz: (mask is no array|this is not a readable .npz archive); do it"
    ):
        read_npz(tmp_path / "a.npz", ("mask",), "do it")


@pytest.mark.parametrize("kind", ["npz", "npy"])
def test_damage_never_traces_back(tmp_path, kind):
    rng, path = np.random.default_rng(0), tmp_path / f"a.{kind}"
    np.savez_compressed(path, a=np.arange(50)) if kind == "npz" else np.save(path, np.arange(50))
    data, refused = path.read_bytes(), 0
    for _ in range(400):
        spoilt = bytearray(data)
        for at in rng.integers(0, len(data), rng.integers(1, 4)):
            spoilt[at] = rng.integers(256)
        path.write_bytes(spoilt[: rng.integers(1, len(data) + 1)] if rng.random() < 0.3 else spoilt)
        try:
            read_npz(path, ("a",), "do it") if kind == "npz" else read_npy(path, "do it")
        except InputError as error:
            refused += 1
            assert str(error).endswith("do it.")
    assert refused > 100


@pytest.mark.parametrize(
    "content", [b"", b"PK\x03\x04 cut short", b"\x93NUMPY\x01\x00", b"\x93NUMPY\x09\x00v\x00{}"]
)
def test_what_is_none_is_said(tmp_path, content):
    (tmp_path / "a").write_bytes(content)
    with pytest.raises(InputError, match="not a readable .npz archive; do it"):
        read_npz(tmp_path / "a", ("a",), "do it")
    with pytest.raises(InputError, match="not a readable .npy array; do it"):
        read_npy(tmp_path / "a", "do it")


def test_objects_are_not_unpickled(tmp_path):
    np.save(tmp_path / "a.npy", np.array([{}], object), allow_pickle=True)
    np.savez(tmp_path / "a.npz", a=np.array([{}], object))
    with pytest.raises(InputError, match="not a readable .npy"):
        read_npy(tmp_path / "a.npy", "do it")
    with pytest.raises(InputError, match="not a readable .npz"):
        read_npz(tmp_path / "a.npz", ("a",), "do it")


def test_arrays_beyond_file_or_memory_are_refused(tmp_path, monkeypatch):
    np.save(tmp_path / "a.npy", np.zeros(3))
    data = (tmp_path / "a.npy").read_bytes()
    (tmp_path / "long.npy").write_bytes(data.replace(b"(3,), }    ", b"(3000000,),"))
    with pytest.raises(InputError, match="not a readable .npy"):
        read_npy(tmp_path / "long.npy", "do it")
    np.savez_compressed(tmp_path / "a.npz", a=np.zeros(1 << 20))
    monkeypatch.setattr("evsdr.errors.free_memory", lambda: 2.0**20)
    with pytest.raises(InputError, match="its arrays would need .* GiB"):
        read_npz(tmp_path / "a.npz", ("a",), "do it")
