"""Large columns lie on disk where there is room, and else in memory: either way they can be written and read."""

import mmap
import os

import numpy as np
import pytest

from evsdr.errors import InputError
from evsdr.files import scratch

KINDS = {"x": np.uint16, "p": np.int8, "t": np.int64}


def root(array):
    """Give what an array's values lie in."""
    while getattr(array, "base", None) is not None:
        array = array.base
    return array.obj if isinstance(array, memoryview) else array


def full(*_):
    raise OSError("no space left")


def test_columns_lie_on_disk_where_memory_is_short(monkeypatch):
    monkeypatch.setattr(scratch, "SHARE", 0.0)
    out = scratch.columns(1001, KINDS, "a recording")
    assert list(out) == list(KINDS) and all(isinstance(root(column), mmap.mmap) for column in out.values())
    for k, column in enumerate(out.values()):
        column[:] = np.arange(1001) % (k + 50)
    for k, (name, column) in enumerate(out.items()):
        assert column.dtype == KINDS[name]
        np.testing.assert_array_equal(column, np.arange(1001) % (k + 50))


def test_a_full_disk_leaves_memory_or_a_sentence(monkeypatch):
    monkeypatch.setattr(scratch, "SHARE", 0.0)
    monkeypatch.setattr(os, "posix_fallocate", full, raising=False)
    assert isinstance(root(scratch.columns(1001, KINDS, "a recording")["t"]), np.ndarray)
    monkeypatch.setattr("evsdr.errors.free_memory", lambda: 1000.0)
    with pytest.raises(InputError, match="a recording would need .* GiB of memory"):
        scratch.columns(1001, KINDS, "a recording")
