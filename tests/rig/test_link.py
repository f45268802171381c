"""The host's end of the process that talks to the ring."""

import os
import signal
import time
from types import SimpleNamespace

import pytest

from evsdr.rig.link import Heard, Link
from evsdr.rig.protocol import RingLost, RingRefused
from tests.support.fake_ring import FakeRing


@pytest.fixture
def talk():
    with FakeRing() as fake:
        heard = []
        port = os.open(fake.port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        link = Link(
            SimpleNamespace(fileno=lambda: port),
            Heard(lambda s: heard.append("status"), heard.append, heard.append),
        )
        yield fake, link, heard
        if link._process.poll() is None:
            link.close()
        os.close(port)


def test_answers_come_back_and_statuses_by_themselves(talk):
    fake, link, heard = talk
    assert link.ask("HELLO").values["leds"] == "24"
    fake.hear = lambda text: fake.say(f"{text.split(' ')[0]} ERR 4 bad argument")
    with pytest.raises(RingRefused, match="4 bad argument"):
        link.ask("SLOT 0 0")
    del fake.hear
    end = time.monotonic() + 10
    while len(heard) < 3 and time.monotonic() < end:
        time.sleep(0.005)
    assert heard[:3] == ["status"] * 3 and link.silence_ms > 0


def test_the_process_is_alone_in_its_session(talk):
    _, link, _ = talk
    assert os.getsid(link._process.pid) == link._process.pid


def test_a_ring_that_is_silent_is_lost(talk):
    fake, link, _ = talk
    fake.silent = True
    with pytest.raises(RingLost, match="no answer comes"):
        link.ask("STOP", 0.05)


def test_a_process_that_dies_is_a_lost_ring(talk):
    _, link, heard = talk
    link.ask("HELLO")
    os.kill(link._process.pid, signal.SIGKILL)
    with pytest.raises(RingLost, match="has gone"):
        link.ask("STOP")
    link._thread.join(5)
    assert heard[-1] == "the process that talks to it has gone"
    link.close()
    assert link._process.returncode == -signal.SIGKILL


def test_the_process_ends_with_the_host_and_not_by_its_signals(talk):
    _, link, _ = talk
    link.ask("HELLO")
    os.kill(link._process.pid, signal.SIGINT)
    assert link.ask("STATUS").values["run"] == "0"
    link.close()
    assert link._process.returncode == 0
