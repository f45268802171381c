"""Masks: every kind of image that means the same is read the same, and damage is named in one sentence."""

import io
import struct
import zlib

import numpy as np
import png
import pytest

from evsdr.errors import InputError
from evsdr.files.mask import read_mask

SHAPE = (5, 7)


@pytest.fixture
def wanted(rng):
    return rng.random(SHAPE) < 0.5


def write_png(path, image, **options):
    with open(path, "wb") as file:
        png.Writer(SHAPE[1], SHAPE[0], **options).write(file, image.reshape(SHAPE[0], -1).tolist())


def check(path, wanted):
    mask = read_mask(path, SHAPE)
    assert mask.dtype == bool
    np.testing.assert_array_equal(mask, wanted)


@pytest.mark.parametrize("value, dtype", [(1, bool), (255, np.uint8), (-3, np.int64), (0.5, np.float32)])
def test_npy(tmp_path, wanted, value, dtype):
    np.save(tmp_path / "mask.npy", (wanted * value).astype(dtype))
    check(tmp_path / "mask.npy", wanted)


@pytest.mark.parametrize("bitdepth, value", [(1, 1), (2, 3), (8, 255), (8, 1), (16, 65535), (16, 1)])
def test_grey_png(tmp_path, wanted, bitdepth, value):
    write_png(tmp_path / "mask.png", wanted * value, greyscale=True, bitdepth=bitdepth)
    check(tmp_path / "mask.png", wanted)


@pytest.mark.parametrize("channel", [0, 1, 2])
def test_colour_png(tmp_path, wanted, channel):
    image = np.zeros((*SHAPE, 3), int)
    image[..., channel] = 200 * wanted
    write_png(tmp_path / "mask.png", image, greyscale=False)
    check(tmp_path / "mask.png", wanted)


@pytest.mark.parametrize("n_colour", [1, 3])
def test_transparency_does_not_count(tmp_path, wanted, n_colour):
    image = np.full((*SHAPE, n_colour + 1), 255)
    image[..., :n_colour] *= wanted[..., None]
    write_png(tmp_path / "mask.png", image, greyscale=n_colour == 1, alpha=True)
    check(tmp_path / "mask.png", wanted)


def test_palette_png(tmp_path, wanted):
    write_png(tmp_path / "mask.png", wanted * 1, palette=[(0, 0, 0), (0, 90, 0)], bitdepth=1)
    check(tmp_path / "mask.png", wanted)


def saved(write) -> bytes:
    file = io.BytesIO()
    write(file)
    return file.getvalue()


def broken_png() -> bytes:
    """Give a PNG whose pixels do not unpack, though its checksums are right."""

    def chunk(name, data):
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    header = struct.pack(">IIBBBBB", SHAPE[1], SHAPE[0], 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", b"not zlib") + chunk(b"IEND", b"")


GREY = saved(
    lambda file: png.Writer(SHAPE[1], SHAPE[0], greyscale=True).write(file, [[255] * SHAPE[1]] * SHAPE[0])
)
ARRAY = saved(lambda file: np.save(file, np.ones(SHAPE)))
BAD = {
    "missing.png": (None, "no such file"),
    "empty.png": (b"", "not a readable"),
    "text.png": (b"0 1 1 0", "not a readable"),
    "cut.png": (GREY[: len(GREY) // 2], "not a readable"),
    "zlib.png": (broken_png(), "not a readable"),
    "array.png": (ARRAY, "not a readable"),
    "empty.npy": (b"", "not a readable"),
    "cut.npy": (ARRAY[:-9], "not a readable"),
    "grey.npy": (GREY, "not a readable"),
    "object.npy": (saved(lambda file: np.save(file, np.full(SHAPE, None))), "not a readable"),
    "archive.npy": (
        saved(lambda file: np.savez(file, mask=np.ones(SHAPE))),
        "not a readable PNG or .npy image",
    ),
    "text.npy": (saved(lambda file: np.save(file, np.full(SHAPE, "yes"))), "not an array of numbers"),
    "record.npy": (saved(lambda file: np.save(file, np.zeros(SHAPE, "i4,i4"))), "not an array of numbers"),
    "turned.npy": (saved(lambda file: np.save(file, np.ones(SHAPE[::-1]))), r"\(7, 5\).*must be .* \(5, 7\)"),
    "colour.npy": (saved(lambda file: np.save(file, np.ones((*SHAPE, 3)))), r"\(5, 7, 3\)"),
    "nan.npy": (saved(lambda file: np.save(file, np.full(SHAPE, np.nan))), "not finite"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_mask(tmp_path, name):
    data, words = BAD[name]
    if data is not None:
        (tmp_path / name).write_bytes(data)
    with pytest.raises(InputError, match=rf"/{name}: .*{words}.*\.$"):
        read_mask(tmp_path / name, SHAPE)


def test_folder_is_no_mask(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_mask(tmp_path, SHAPE)
