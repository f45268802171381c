"""The process that talks to the ring, here in this one and on a clock of its own."""

import socket
from types import SimpleNamespace

import pytest

from evsdr.rig import keeper
from evsdr.rig.keeper import Keeper
from evsdr.rig.protocol import BEAT_S, LOST_S, REPEAT_S, frame, unframe


class Wire:
    """A keeper, the ring's end of its port, and the time."""

    def __init__(self):
        self.ring, port = socket.socketpair()
        self.port, self.now = port, 100.0
        for end in (self.ring, port):
            end.setblocking(False)
        self.keeper = Keeper(port.fileno())

    def after(self, seconds, *answers, beat=False):
        """Let time pass, then the ring speak; give what the host hears, and what the ring gets."""
        self.now += seconds
        for answer in answers:
            self.ring.send(frame(answer))
        told = self.keeper.step(bool(answers))
        if beat:
            self.keeper.beat()
        try:
            lines = self.ring.recv(4096).split(b"\n")
        except BlockingIOError:
            lines = []
        return told, [unframe(line) for line in lines if line]


@pytest.fixture
def wire(monkeypatch):
    wire = Wire()
    monkeypatch.setattr(keeper, "time", SimpleNamespace(monotonic=lambda: wire.now))
    yield wire
    wire.ring.close()
    wire.port.close()


def test_a_request_is_repeated_until_it_is_answered(wire):
    wire.keeper.ask("a 1 STOP")
    assert wire.after(0) == ([], ["1 STOP"])
    assert wire.after(REPEAT_S / 2) == ([], [])
    assert wire.after(REPEAT_S) == ([], ["1 STOP"])
    assert wire.after(0.001, "1 OK fine") == (["a OK fine"], [])
    assert wire.after(0.001, "1 OK fine") == ([], [])  # the answer to the second


def test_what_nobody_answers_is_lost(wire):
    wire.keeper.ask("a 0.1 STOP")
    wire.keeper.ask("b 0.1 HELLO")
    assert wire.after(0) == ([], ["1 STOP"])
    assert wire.after(0.2)[0] == ["a LOST no answer comes"]
    assert wire.after(0.001) == ([], ["2 HELLO"])


def test_the_ring_is_kept_alive_whatever_is_asked(wire):
    wire.keeper.ask("a 1 HELLO")
    assert wire.after(0, beat=True)[1] == [
        "1 HELLO"
    ]  # no beat before it has answered: it may be in its bootloader
    assert wire.after(0, "1 OK", beat=True)[1] == ["65535 STATUS"]
    wire.keeper.ask("b 1 SLOT 1000 0")
    assert wire.after(BEAT_S, beat=True)[1] == ["2 SLOT 1000 0", "65535 STATUS"]
    assert wire.after(BEAT_S, beat=True)[1] == ["65535 STATUS"]
    assert wire.after(3 * BEAT_S, "65535 OK run=1", beat=True)[0] == ["S 10.0 OK run=1"]
    assert wire.after(BEAT_S, "# BOOT x", "65535 OK run=0")[0] == ["# BOOT x", "S 30.0 OK run=0"]


def test_a_spoiled_line_is_sent_again_soon(wire):
    wire.keeper.ask("a 1 STOP")
    wire.after(0)
    wire.after(0.001, "- ERR 1 checksum")
    assert "1 STOP" in wire.after(0.003)[1]


def test_a_silent_ring_and_a_port_that_has_gone_are_told_once(wire):
    wire.keeper.ask("a 1 STOP")
    wire.after(0)
    wire.after(0, "1 OK")
    assert wire.after(1.1 * LOST_S)[0] == ["! no answer comes"] and wire.after(LOST_S)[0] == []
    wire.keeper.ask("b 1 STOP")
    wire.ring.close()
    asked, lost = wire.keeper.step(True)
    assert asked.startswith("b LOST the port has gone (") and lost.startswith("! the port has gone")
    assert wire.keeper.timeout() == 1.0
