"""Spoiled files of every kind are read, or refused in a sentence; and the experiment notices what else there is."""

import time
from collections import Counter

import numpy as np
import pytest

from evsdr import InputError
from experiments.fuzz import compute
from experiments.fuzz.compute import ENDED, HANG, Reader, fuzz, playground, table
from experiments.fuzz.mutate import spoil_bytes, spoil_text
from experiments.fuzz.targets import TARGETS
from experiments.fuzz.worker import ACCEPTED, NOT_FINITE, REFUSED, TRACEBACK, outcome


@pytest.mark.slow
def test_spoiled_files_are_read_or_refused():
    cases = fuzz(15.0, seed=77)
    bad = [
        (TARGETS[c.target].file, c.seed, c.outcome, c.words)
        for c in cases
        if c.outcome not in (ACCEPTED, REFUSED)
    ]
    assert not bad
    counts = sum((count for _, count in table(cases)), Counter())
    assert counts.total() == len(cases) and counts[REFUSED] > counts[ACCEPTED] / 10


def test_whole_files_are_read():
    with playground() as folder:
        for target in TARGETS:
            assert outcome(target.read, folder / "whole") == (ACCEPTED, ""), target.file


def test_what_else_comes_is_noticed(tmp_path):
    def raises(error):
        def read(folder):
            raise error

        return outcome(read, tmp_path)[0]

    assert raises(InputError("a: b; c.")) == REFUSED
    assert raises(InputError("a\nb.")) == TRACEBACK and raises(KeyError("a")) == TRACEBACK
    assert outcome(lambda folder: {"a": [1.0, np.float32([np.nan])]}, tmp_path)[0] == NOT_FINITE


def test_a_child_that_hangs_or_ends_is_noticed(tmp_path, monkeypatch):
    real = compute.subprocess.Popen
    words = (
        "import faulthandler, sys; faulthandler.enable(); print('last words', file=sys.stderr, flush=True)"
    )

    def instead(program):
        return lambda command, **how: real(
            [command[0], "-c", f"{words}; print('ready', flush=True); input(); {program}"], **how
        )

    start = time.monotonic()
    for program, patience, expected in (
        ("import time; time.sleep(60)", 0.3, HANG),
        ("import os; os.abort()", 20, ENDED),
    ):
        monkeypatch.setattr(compute.subprocess, "Popen", instead(program))
        reader = Reader(patience)
        outcome, said = reader.read(0, tmp_path)
        assert outcome == expected and reader.child is None
        assert (
            "last words\nFatal Python error: Aborted" in said
            and f"after 0 other files; alone: {expected}" in said
        )
    assert time.monotonic() - start < 20


def test_files_are_spoiled_the_same_way_again():
    text = b"a 1.5, b 22\nc\n" * 20
    for spoil in (spoil_bytes, spoil_text):
        one, again, other = (spoil(text, np.random.default_rng(seed)) for seed in (1, 1, 2))
        assert one == again != text and other != one
