"""Arrays of NumPy in Dr.Jit's own memory."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from evsdr.model.arrays import columns, owned, picked
from evsdr.model.illumination import Illumination


def test_values_are_copied():
    """What changes later does not reach the array; memory that is not aligned is no matter."""
    values = np.arange(40, dtype=np.float32)[1:9]
    array = owned(mi.Float, values)
    values[:] = -1
    np.testing.assert_array_equal(array, np.arange(1, 9))


def test_kinds():
    assert owned(mi.UInt32, np.array([True, False])).numpy().tolist() == [1, 0]
    assert owned(mi.UInt32, np.array([2**32 - 1])).numpy().tolist() == [2**32 - 1]
    assert [c.numpy().tolist() for c in columns(mi.Float, np.array([[1, 2], [3, 4]]))] == [[1, 3], [2, 4]]


def test_some_pixels_of_all_arrays():
    """Of lists, tuples and records; what is the same everywhere, and no array, stays."""
    light = Illumination([mi.Vector3f(0, 0, 1)], [mi.Float(1, 2, 3)], [0], mi.Float(0.5), None, 0.25)
    found, (both,) = picked((light, [mi.Vector3f([1, 2, 3], [4, 5, 6], [7, 8, 9])]), mi.UInt32(2, 0))
    assert found.irradiance[0].numpy().tolist() == [3, 1] and both.y.numpy().tolist() == [6, 4]
    assert dr.width(found.direction[0]) == 1 and found.constant_light is light.constant_light
    assert (found.band, found.indirect, found.spread) == ([0], None, 0.25)


def test_frozen_functions_are_recorded_once_for_any_memory():
    @dr.freeze
    def double(x):
        return 2 * x

    whole = np.arange(100, dtype=np.float32)
    for first in range(5):
        np.testing.assert_array_equal(double(owned(mi.Float, whole[first:])), 2 * whole[first:])
    assert double.n_recordings == 1


@pytest.mark.parametrize("kind", [mi.Float, mi.UInt32])
@pytest.mark.parametrize("n", [1, 346])
def test_one_kernel_for_any_memory(kind, n):
    """NumPy's memory is aligned to 64 bytes by chance only."""
    dr.kernel_history_clear()
    kept = []
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
        for _ in range(30):
            kept.append(owned(kind, np.arange(n)))
            dr.eval(kept[-1] + dr.opaque(kind, 1))
    hashes = {kernel["hash"] for kernel in dr.kernel_history([dr.KernelType.JIT])}
    assert len(hashes) == 1
