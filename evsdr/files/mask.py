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
        The file can't be read, has another size or is no mask.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file; give the path of a mask.")
    try:
        if path.suffix == ".npy":
            image = np.load(path, allow_pickle=False)
        else:
            width, height, rows, info = png.Reader(bytes=path.read_bytes()).asDirect()
            image = np.array([list(row) for row in rows]).reshape(height, width, info["planes"])
            colours = info["planes"] - info["alpha"]  # transparency does not count
            image = image[..., :colours].any(axis=-1)
    except Exception as error:  # NumPy, pypng and zlib raise ten kinds on damage
        raise InputError(f"{path}: not a readable PNG or .npy image; save the mask as one.") from error
    if not isinstance(image, np.ndarray) or image.dtype.kind not in "biuf":
        raise InputError(f"{path}: the mask is not an array of numbers; save 0 and 1.")
    if image.shape != shape:
        raise InputError(f"{path}: the mask has shape {image.shape}; it must be (height, width) = {shape}.")
    if not np.isfinite(image).all():
        raise InputError(f"{path}: the mask is not finite everywhere; save 0 and 1.")
    return image != 0
