"""What costly work gave last, remembered as long as what it was asked of is there."""

from collections.abc import Callable
from weakref import ref

import numpy as np

WORDS = bool, int, float, str, type(None), np.generic


class Memo:
    """Remembers the latest results of costly work: keys are equal if their parts are the same objects or words.

    It does not keep those objects, as a fit of many pixels takes much memory; with one of them its result goes.
    """

    def __init__(self):
        self._kept = {}

    def __call__(self, kind: str, key: tuple, work: Callable, most: int = 1):
        """Give the result of `work()`, or of one of the latest of this kind with this key."""
        kept = self._kept.setdefault(kind, [])
        kept[:] = [(known, value) for known, value in kept if not any(map(_gone, known))]
        for k, (known, value) in enumerate(kept):
            if all(_same(held, part) for held, part in zip(known, key)):
                kept.insert(0, kept.pop(k))
                return value
        del kept[most - 1 :]  # before the work, which needs the room
        value = work()
        kept.insert(0, (tuple(part if isinstance(part, WORDS) else holder(part) for part in key), value))
        return value

    def only(self, *kinds: str) -> "Memo":
        """Remember less."""
        less = Memo()
        less._kept = {kind: list(kept) for kind, kept in self._kept.items() if kind in kinds}
        return less


def holder(part) -> Callable:
    """Give what gives an object as long as it is there, None from then on; what can't be referred to weakly is kept."""
    try:
        return ref(part)
    except TypeError:
        return lambda: part


def _gone(held) -> bool:
    return callable(held) and held() is None


def _same(held, part) -> bool:
    return held() is part if callable(held) else isinstance(part, WORDS) and held == part
