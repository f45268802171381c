"""Masks that users draw."""

from pathlib import Path

import numpy as np
import png

from evsdr.errors import InputError
from evsdr.files.arrays import read_npy


def read_mask(path: Path, shape: tuple[int, int]) -> np.ndarray:
    """Read a PNG or .npy image whose non-zero pixels count.

    Parameters
    ----------
    shape : (int, int)
        Height and width it must have.

    Returns
    -------
    (height, width) bool

    Raises
    ------
    InputError
        The file can't be read, has another size or is no mask.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file; give the path of a mask.")
    try:
        image = read_npy(path, "") if path.suffix == ".npy" else _read_png(path, shape)
    except MemoryError:
        raise
    except Exception as error:  # NumPy, pypng and zlib raise ten kinds on damage
        raise InputError(f"{path}: not a readable PNG or .npy image; save the mask as one.") from error
    if image.dtype.kind not in "biuf":
        raise InputError(f"{path}: the mask is not an array of numbers; save 0 and 1.")
    if image.shape != shape:
        raise InputError(f"{path}: the mask has shape {image.shape}; it must be (height, width) = {shape}.")
    if not np.isfinite(image).all():
        raise InputError(f"{path}: the mask is not finite everywhere; save 0 and 1.")
    return image != 0


def _read_png(path: Path, shape: tuple[int, int]) -> np.ndarray:
    """Give where a PNG is not black; zeros of its size if that is another than the one it must have."""
    reader = png.Reader(bytes=path.read_bytes())
    reader.preamble()
    if (reader.height, reader.width) != shape:
        return np.broadcast_to(False, (reader.height, reader.width))
    width, height, rows, info = reader.asDirect()
    image = np.array([list(row) for row in rows]).reshape(height, width, info["planes"])
    colours = info["planes"] - info["alpha"]  # transparency does not count
    return image[..., :colours].any(axis=-1)
