"""maps.npz comes back as it was written, and is refused in a sentence where it is something else."""

import numpy as np
import pytest

from evsdr.errors import InputError
from evsdr.files.maps import read_maps, read_results
from evsdr.files.results import write_results
from evsdr.records import Maps

FIELDS = list(Maps.__dataclass_fields__)


@pytest.fixture
def maps(rng):
    normal = rng.normal(size=(3, 4, 3)).astype(np.float32)
    return Maps(
        normal=normal,
        reflectance=rng.random((3, 4, 2), np.float32),
        mask=rng.random((3, 4)) > 0.5,
        normal_sigma_deg=rng.random((3, 4), np.float32),
        reflectance_sigma=rng.random((3, 4, 2), np.float32),
        band_wavelength_nm=np.float32([450, 620]),
        mask_reflectance=rng.random((3, 4)) > 0.5,
    )


def test_files_without_known_scales_are_read(maps, tmp_path):
    """Those of older versions: what is known of normals is taken for both."""
    arrays = {name: array for name, array in vars(maps).items() if name != "mask_reflectance"}
    np.savez(tmp_path / "maps.npz", **arrays)
    np.testing.assert_array_equal(read_maps(tmp_path / "maps.npz").mask_reflectance, maps.mask)


def test_what_a_fit_writes_comes_back(maps, tmp_path):
    write_results(tmp_path, maps, {})
    again = read_maps(tmp_path / "maps.npz")
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(again, name), getattr(maps, name))


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"normal": None}, "not a maps.npz with normal, "),
        ({"mask": np.ones((4, 3), bool)}, "other shapes than evsdr.fit writes, or are not finite"),
        ({"reflectance": np.full((3, 4, 2), np.nan)}, "or are not finite; fit again"),
        ({"band_wavelength_nm": np.float32([450])}, "other shapes"),
    ],
)
def test_what_is_refused(maps, tmp_path, change, sentence):
    arrays = {name: array for name, array in (vars(maps) | change).items() if array is not None}
    np.savez(tmp_path / "maps.npz", **arrays)
    with pytest.raises(InputError, match=f"maps.npz: .*{sentence}"):
        read_maps(tmp_path / "maps.npz")


def test_no_file_and_no_archive(tmp_path):
    with pytest.raises(InputError, match="there is no such file"):
        read_maps(tmp_path / "maps.npz")
    (tmp_path / "maps.npz").write_bytes(b"PK\x03\x04 cut short")
    with pytest.raises(InputError, match="not a readable .npz archive"):
        read_maps(tmp_path / "maps.npz")


def test_results_that_are_not_of_one_fit_are_refused(maps, tmp_path):
    write_results(tmp_path, maps, {"verdict": "trustworthy"})
    again, summary = read_results(tmp_path)
    np.testing.assert_array_equal(again.normal, maps.normal)
    assert summary["verdict"] == "trustworthy" and "normal.exr" in summary["files"]
    with open(tmp_path / "normal.exr", "ab") as file:
        file.write(b"more")
    with pytest.raises(InputError, match="normal.exr: this is not the file that"):
        read_results(tmp_path)
    (tmp_path / "normal.exr").unlink()
    with pytest.raises(InputError, match="normal.exr: there is no such file, but"):
        read_results(tmp_path)
    (tmp_path / "summary.json").write_text("{}")
    with pytest.raises(InputError, match="it names no files"):
        read_results(tmp_path)
