"""Costly work is remembered by what it was asked of, which is not kept."""

from weakref import finalize

import numpy as np

from evsdr.effects.memo import Memo


def test_a_memo_keeps_the_latest_by_identity():
    memo, made = Memo(), []
    first, second = np.zeros(1), np.zeros(1)

    def ask(kind, key, name):
        return memo(kind, key, lambda: made.append(name) or name, 2)

    assert ask("a", (first, 1), "x") == ask("a", (first, 1.0), "y") == "x"
    assert ask("a", (second, 1), "y") == "y"
    assert ask("b", (first, 1), "z") == "z"
    assert ask("a", (first, 1), "w") == "x"
    ask("a", (first, 2), "v")
    assert ask("a", (second, 1), "u") == "u" and ask("a", (first, 2), "t") == "v"
    assert made == ["x", "y", "z", "v", "u"]


def test_a_memo_does_not_keep_what_it_was_asked_of():
    memo = Memo()
    asked, gone = np.zeros(1), []
    finalize(asked, gone.append, True)
    assert memo("a", (asked, np.bool_(True)), lambda: "x") == "x"
    assert memo("a", (asked, np.bool_(True)), lambda: "y") == "x"
    del asked
    assert gone and memo("a", (np.zeros(1), np.bool_(True)), lambda: "z") == "z"


def test_what_can_not_be_referred_to_weakly_is_kept():
    memo, asked = Memo(), (1, 2)
    assert memo("a", (asked,), lambda: "x") == memo("a", (asked,), lambda: "y") == "x"
    assert memo("a", ((1, 3),), lambda: "z") == "z"
