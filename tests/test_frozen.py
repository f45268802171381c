"""Python's cycle collector rests while frozen functions are recorded."""

import gc
import weakref

import drjit as dr
import mitsuba as mi
import pytest

from evsdr.frozen import RECORDINGS, no_garbage_collection, recorded


class Circle:
    def __init__(self):
        self.own = self


def test_garbage_stays_within():
    with no_garbage_collection():
        assert not gc.isenabled()
        within = weakref.ref(Circle())
        assert within() is not None
    assert gc.isenabled()


def test_the_collector_is_left_as_it_was():
    with pytest.raises(RuntimeError), no_garbage_collection():
        raise RuntimeError
    assert gc.isenabled()
    gc.disable()
    try:
        with no_garbage_collection():
            pass
        assert not gc.isenabled()
    finally:
        gc.enable()


def test_recordings_of_many_scenes_are_dropped_without_a_word(capfd):
    """Each kind of argument is a recording; the oldest ones go."""

    @recorded
    def first(values):
        return values[0] + 1

    one = dr.opaque(mi.Float, 1.0)
    for n in range(1, RECORDINGS + 20):
        assert float(first([one] * n)[0]) == 2
    assert first.n_recordings <= RECORDINGS + 20
    assert "recorded" not in capfd.readouterr().err
