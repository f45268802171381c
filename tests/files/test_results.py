"""Results: every file is read back by another reader, and a failure leaves nothing."""

import json
from dataclasses import fields, replace

import numpy as np
import OpenEXR
import png
import pytest

from evsdr.errors import InputError
from evsdr.files.daylight import reflectance_to_srgb
from evsdr.files.results import (
    encode_normal,
    spectral_channels,
    write_exr,
    write_results,
)
from evsdr.records import Maps

HEIGHT, WIDTH = 6, 9
WAVELENGTH_NM = np.array([620.0, 405, 450, 470, 505, 525, 590, 660], np.float32)  # not in order
FILES = {"maps.npz", "normal.exr", "reflectance.exr", "normal.png", "reflectance.png", "summary.json"}


@pytest.fixture
def maps() -> Maps:
    rng = np.random.default_rng(3)
    n_band = len(WAVELENGTH_NM)
    normal = rng.normal(size=(HEIGHT, WIDTH, 3))
    normal[..., 2] = np.abs(normal[..., 2])
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    mask = rng.random((HEIGHT, WIDTH)) > 0.2
    return Maps(
        normal.astype(np.float32),
        rng.random((HEIGHT, WIDTH, n_band), np.float32),
        mask,
        rng.random((HEIGHT, WIDTH), np.float32),
        rng.random((HEIGHT, WIDTH, n_band), np.float32),
        WAVELENGTH_NM,
    )


def read_png(path):
    width, height, rows, info = png.Reader(bytes=path.read_bytes()).read()
    image = np.vstack([np.asarray(row) for row in rows])
    return image.reshape(height, width, info["planes"]), info["bitdepth"]


def test_folder_holds_all_files(tmp_path, maps):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "notes.txt").write_text("kept")
    (tmp_path / "out" / "maps.npz").write_text("old")
    write_results(tmp_path / "out", maps, {})
    assert {file.name for file in (tmp_path / "out").iterdir()} == FILES | {"notes.txt"}
    with np.load(tmp_path / "out" / "maps.npz") as file:
        assert set(file) == {field.name for field in fields(Maps)}
        for name in file:
            np.testing.assert_array_equal(file[name], getattr(maps, name))
            assert file[name].dtype == getattr(maps, name).dtype


def test_normal_exr(tmp_path, maps):
    write_results(tmp_path, maps, {})
    with OpenEXR.File(str(tmp_path / "normal.exr"), separate_channels=True) as file:
        for i, name in enumerate("RGB"):
            np.testing.assert_array_equal(file.channels()[name].pixels, maps.normal[..., i])


def test_reflectance_exr(tmp_path, maps):
    write_results(tmp_path, maps, {})
    with OpenEXR.File(str(tmp_path / "reflectance.exr"), separate_channels=True) as file:
        assert file.header()["spectralLayoutVersion"] == "1.0"
        channels = {name: channel.pixels for name, channel in file.channels().items()}
    assert len(channels) == len(WAVELENGTH_NM)
    for b, nm in enumerate(WAVELENGTH_NM):
        pixels = channels[f"T.{int(nm)},000000nm"]
        np.testing.assert_array_equal(pixels, maps.reflectance[..., b])
        assert pixels.dtype == np.float32


def test_channel_names_differ():
    names = spectral_channels([405.0, 530.25, 405.0, 405.000001, 99.9999999])
    assert names == [
        "T.405,000000nm",
        "T.530,250000nm",
        "T.405,000001nm",
        "T.405,000002nm",
        "T.100,000000nm",
    ]


def test_normal_png_is_exact_to_16_bit(tmp_path, maps):
    """Half a step of 2/65535 per axis is an angle of up to 0.0015 degrees."""
    write_results(tmp_path, maps, {})
    image, bits = read_png(tmp_path / "normal.png")
    assert bits == 16 and image.shape == (HEIGHT, WIDTH, 3)
    decoded = image / 65535 * 2 - 1
    assert np.abs(decoded - maps.normal)[maps.mask].max() <= 1 / 65535 + 1e-7
    np.testing.assert_array_equal(image[~maps.mask], np.tile([32768, 32768, 65535], ((~maps.mask).sum(), 1)))


def test_normal_png_is_not_flipped():
    """Right is red, up is green, toward the camera is blue; row 0 is the top."""
    normal = np.array([[[1.0, 0, 0], [0, 1, 0]], [[0, 0, 1], [0, -1, 0]]])
    expected = [[[65535, 32768, 32768], [32768, 65535, 32768]], [[32768, 32768, 65535], [32768, 0, 32768]]]
    np.testing.assert_array_equal(encode_normal(normal, np.ones((2, 2), bool)), expected)


def test_reflectance_png(tmp_path, maps):
    white = maps.mask.copy()
    white[:3] = False
    maps = replace(maps, reflectance=np.where(white[..., None], 1, maps.reflectance))
    write_results(tmp_path, maps, {})
    image, bits = read_png(tmp_path / "reflectance.png")
    assert bits == 8
    np.testing.assert_array_equal(image[white], 255)
    np.testing.assert_array_equal(image[~maps.mask], 0)
    expected = 255 * reflectance_to_srgb(maps.reflectance, maps.band_wavelength_nm)[maps.mask]
    assert np.abs(image[maps.mask] - expected).max() <= 0.5 + 1e-9


def test_summary(tmp_path, maps):
    numbers = {"mae_deg": np.float32(1.5), "n_event": np.int64(7), "seconds": {"read": 0.25}}
    write_results(tmp_path, maps, numbers | {"modelled": np.bool_(True), "slots": np.arange(3), "why": "dim"})
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert set(summary.pop("files")) == FILES - {"summary.json"}
    assert summary == {
        "mae_deg": 1.5,
        "n_event": 7,
        "seconds": {"read": 0.25},
        "modelled": True,
        "slots": [0, 1, 2],
        "why": "dim",
    }


@pytest.mark.parametrize("summary", [{"mae_deg": float("nan")}, {"rmse": np.float32("inf")}])
def test_summary_refuses_what_is_no_json(tmp_path, maps, summary):
    with pytest.raises(ValueError):
        write_results(tmp_path / "out", maps, summary)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["normal", "reflectance", "normal_sigma_deg", "reflectance_sigma"])
def test_maps_must_be_finite(tmp_path, maps, name):
    array = getattr(maps, name).copy()
    array.flat[0] = np.nan
    with pytest.raises(ValueError, match=f"{name} must be finite"):
        write_results(tmp_path / "out", replace(maps, **{name: array}), {})
    assert list(tmp_path.iterdir()) == []


def test_failure_leaves_nothing(tmp_path, maps):
    """The last image fails, after all arrays are written."""
    broken = replace(maps, band_wavelength_nm=WAVELENGTH_NM[:-1])
    with pytest.raises(ValueError):
        write_results(tmp_path / "a" / "out", broken, {})
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "maps.npz").write_text("old")
    with pytest.raises(ValueError):
        write_results(tmp_path, broken, {})
    assert [file.name for file in tmp_path.iterdir()] == ["maps.npz"]
    assert (tmp_path / "maps.npz").read_text() == "old"


def test_unwritable_exr(tmp_path):
    with pytest.raises(OSError, match="x.exr"):
        write_exr(tmp_path / "none" / "x.exr", {"RGB": np.zeros((2, 2, 3))})


def test_out_that_is_a_file(tmp_path, maps):
    out = tmp_path / "out"
    out.write_text("mine")
    with pytest.raises(InputError, match="out: cannot be written"):
        write_results(out, maps, {})
    assert out.read_text() == "mine"
