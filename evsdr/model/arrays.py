"""Arrays of Dr.Jit made from those of NumPy."""

from dataclasses import fields, is_dataclass, replace

import drjit as dr
import numpy as np

ALIGNMENT = 64  # bytes: the most that Dr.Jit asks of any array (drjit-core, jitc_var_mem_map)


def owned(kind: type, values: np.ndarray):
    """Copy NumPy values to where Dr.Jit reads them as it reads its own.

    `kind(values)` maps NumPy's memory, which is aligned or not, by chance; Dr.Jit compiles a kernel, and records a
    frozen function, for either case.

    Parameters
    ----------
    kind : type
        Dr.Jit type, such as Float.
    values : (n,) array
        Cast to the type's own.

    Returns
    -------
    kind, (n)
        Evaluated. Of no values one zero is made, as kernels take no empty array.
    """
    number = np.dtype(np.uint32 if kind is dr.uint32_array_t(kind) else np.float32)
    values = values if len(values) else np.zeros(1)
    memory = np.empty(number.itemsize * len(values) + ALIGNMENT, np.uint8)
    aligned = memory[-memory.ctypes.data % ALIGNMENT :][: number.itemsize * len(values)].view(number)
    aligned[:] = values
    return kind(aligned)


def picked(tree, index):
    """Keep some pixels, UInt32 (n), of all arrays of a PyTree; what is the same everywhere stays of width 1."""
    if dr.is_array_v(tree):
        return tree if dr.width(tree) == 1 else dr.gather(type(tree), tree, index)
    if isinstance(tree, list | tuple):
        return type(tree)(picked(value, index) for value in tree)
    if is_dataclass(tree):
        return replace(
            tree, **{field.name: picked(getattr(tree, field.name), index) for field in fields(tree)}
        )
    return tree


def columns(kind: type, values: np.ndarray) -> list:
    """Copy the columns of an array (n, m) into m arrays of width n."""
    return [owned(kind, column) for column in values.T]


def rows(vector) -> np.ndarray:
    """Give vectors of Dr.Jit as an array (n, 3); `np.array(vector)` would compile a kernel for each n."""
    return np.stack([c.numpy() for c in vector], axis=-1)
