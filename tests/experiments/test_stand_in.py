"""The ring without a chip goes dark as the firmware does."""

import pytest

from experiments.bench.__main__ import told_right
from experiments.bench.alive import Run
from experiments.bench.stand_in import StandIn

DARK = "OK run=0 rounds=0 light=0 cause=alive"


@pytest.mark.parametrize(
    ("silence_s", "answer"), [(0.0485, "OK run=1 rounds=0 light=1 cause=none"), (0.0495, DARK)]
)
def test_a_silent_host_finds_it_dark(silence_s, answer):
    ring = StandIn(round_s=1.0, alive_s=0.04)
    for at, command in enumerate(("ALIVE 49", "LIGHT 1", "RUN", "STATUS")):
        assert ring.answer(f"{at} {command}", 10 + 0.04 * at).startswith(f"{at} OK")
    assert ring.answer("9 STATUS", 10.12 + silence_s) == f"9 {answer}"
    assert ring.silence_s == pytest.approx(silence_s)


def test_a_dark_ring_does_not_mind():
    ring = StandIn(round_s=1.0, alive_s=0.04)
    ring.answer("1 STATUS", 10.0)
    assert ring.answer("2 STATUS", 12.0) == "2 OK run=0 rounds=0 light=0 cause=none" and ring.silence_s == 0


def test_rounds_end_in_time():
    ring = StandIn(round_s=0.01)
    for command in ("ROUNDS 3", "RUN"):
        ring.answer(f"1 {command}", 10.0)
    assert ring.answer("2 STATUS", 10.0249) == "2 OK run=1 rounds=2 light=0 cause=none"
    assert ring.answer("2 STATUS", 10.031) == "2 OK run=0 rounds=3 light=0 cause=done"


@pytest.mark.parametrize(
    ("ended", "silence_ms", "right"),
    [("done", 48.0, True), ("watchdog", 52.0, True), ("done", 52.0, False), ("watchdog", 12.0, False)],
)
def test_the_host_tells_what_the_ring_did(ended, silence_ms, right):
    good = Run("done", 11.0, 10.5, 0.4)
    assert told_right([good, Run(ended, silence_ms, 10.0, 40.0)]) == (f"{1 + right} of 2", right)
