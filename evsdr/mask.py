"""Masks that users draw."""

from pathlib import Path

import numpy as np
import png

from evsdr.errors import InputError


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
        The file can't be read or has another size.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file; give the path of a mask.")
    try:
        if path.suffix == ".npy":
            image = np.load(path, allow_pickle=False)
        else:
            width, height, rows, info = png.Reader(filename=str(path)).asDirect()
            image = np.array([list(row) for row in rows]).reshape(height, width, info["planes"])
            colours = info["planes"] - info["alpha"]  # transparency does not count
            image = image[..., :colours].any(axis=-1)
    except (OSError, ValueError, EOFError, png.Error) as error:
        raise InputError(f"{path}: not a readable PNG or .npy image; save the mask as one of these.") from error
    if image.shape != shape:
        raise InputError(f"{path}: the mask has shape {image.shape}; it must be (height, width) = {shape}.")
    return image != 0
