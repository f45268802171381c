"""Signals stop a command, and wait while they must."""

import os
import signal
import sys
import threading
import time

import pytest

from evsdr import signals
from evsdr.signals import Patience, stoppable, undisturbed

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")


@pytest.fixture(autouse=True)
def handlers():
    """Handlers as a fresh process has them."""
    fresh = {
        signal.SIGINT: signal.default_int_handler,
        signal.SIGTERM: signal.SIG_DFL,
        signal.SIGALRM: signal.SIG_DFL,
    }
    before = {number: signal.signal(number, handler) for number, handler in fresh.items()}
    yield fresh
    assert {number: signal.getsignal(number) for number in fresh} == fresh
    for number, handler in before.items():
        signal.signal(number, handler)


def send(number):
    os.kill(os.getpid(), number)
    time.sleep(0.05)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_stop(number):
    came = []
    with pytest.raises(KeyboardInterrupt), stoppable(came):
        send(number)
    assert came == [number]


def test_a_stop_that_was_swallowed_comes_again(monkeypatch):
    monkeypatch.setattr(signals, "AGAIN", 0.1)
    came, swallowed = [], 0
    with pytest.raises(KeyboardInterrupt), stoppable(came):
        for _ in range(3):
            try:
                if not swallowed:
                    send(signal.SIGINT)
                time.sleep(5)
            except KeyboardInterrupt:
                swallowed += 1
        time.sleep(5)
    assert came == [signal.SIGINT] and swallowed == 3
    time.sleep(0.2)  # nothing comes any more


def test_a_stop_where_nothing_can_be_raised_is_quiet(monkeypatch):
    """In a destructor; it comes again."""

    class Slow:
        def __del__(self):
            send(signal.SIGINT)
            time.sleep(5)

    monkeypatch.setattr(signals, "AGAIN", 0.1)
    monkeypatch.setattr(sys, "unraisablehook", pytest.fail)
    with pytest.raises(KeyboardInterrupt), stoppable([]):
        Slow()
        time.sleep(5)
    assert sys.unraisablehook is pytest.fail


def test_what_others_handle_stays():
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    came = []
    with stoppable(came):
        send(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN and not came
    signal.signal(signal.SIGINT, signal.default_int_handler)


def test_signals_wait_while_they_must():
    came, done = [], []
    with pytest.raises(KeyboardInterrupt), stoppable(came):
        with undisturbed():
            send(signal.SIGTERM)
            done.append(1)
        done.append(2)
    assert came == [signal.SIGTERM] and done == [1]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_patience_notes_the_first_stop_and_the_next_one_stops(number):
    came = []
    with pytest.raises(KeyboardInterrupt), stoppable(came), Patience() as patience:
        patience.begin()
        patience.begin()
        send(number)
        assert patience.came is number and not came
        send(number)
    assert came == [number]


def test_patience_that_has_not_begun_or_has_ended_stops_at_once():
    for begun in (False, True):
        with pytest.raises(KeyboardInterrupt), stoppable([]):
            with Patience() as patience:
                if begun:
                    patience.begin()
                else:
                    send(signal.SIGINT)
            send(signal.SIGINT)
        assert patience.came is None


def test_a_stop_in_the_midst_of_writing_is_noted_by_the_patient():
    with stoppable([]), Patience() as patience:
        patience.begin()
        with undisturbed():
            send(signal.SIGINT)
            assert patience.came is None
        assert patience.came is signal.SIGINT


def test_other_threads_do_not_listen():
    done = []

    def work():
        with stoppable([]), undisturbed():
            done.append(1)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert done == [1]
