"""Python's cycle collector rests while frozen functions are recorded."""

import gc
import weakref

import pytest

from evsdr.frozen import no_garbage_collection


class Circle:
    def __init__(self):
        self.own = self


def test_garbage_goes_before_and_stays_within():
    before = weakref.ref(Circle())
    with no_garbage_collection():
        assert before() is None and not gc.isenabled()
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
