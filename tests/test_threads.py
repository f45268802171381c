"""Work in chunks: each one once, several at a time, and what goes wrong is heard."""

import threading
import time

import pytest

from evsdr.errors import InputError
from evsdr.threads import N_CHUNK, in_chunks, limited, most_threads


def test_each_chunk_is_worked_on_once():
    done = []
    in_chunks(done.append)
    assert sorted(done) == list(range(N_CHUNK))


def test_chunks_run_side_by_side():
    """Two chunks that wait for each other would wait for ever one after the other."""
    both = threading.Barrier(2)
    in_chunks(lambda chunk: both.wait(timeout=20) if chunk < 2 else None)


def test_an_error_is_raised():
    def work(chunk):
        if chunk == N_CHUNK - 1:
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        in_chunks(work)


def test_after_an_error_no_more_are_begun(monkeypatch):
    """As after Ctrl-C."""
    monkeypatch.setenv("EVSDR_THREADS", "2")
    begun = []

    def work(chunk):
        begun.append(chunk)
        if chunk == 0:
            raise KeyboardInterrupt
        time.sleep(0.01)

    with pytest.raises(KeyboardInterrupt):
        in_chunks(work)
    assert len(begun) < 5


def test_the_user_may_ask_for_fewer(monkeypatch):
    for name, value in limited(3).items():
        monkeypatch.setenv(name, value)
    assert most_threads() == 3
    seen = set()
    in_chunks(lambda _: (time.sleep(0.005), seen.add(threading.get_ident())))
    assert len(seen) == 3
    monkeypatch.setenv("EVSDR_THREADS", "")
    assert most_threads() is None
    monkeypatch.setenv("EVSDR_THREADS", "two")
    with pytest.raises(InputError, match="EVSDR_THREADS is 'two'"):
        most_threads()


def test_one_thread_is_this_one(monkeypatch):
    monkeypatch.setenv("EVSDR_THREADS", "1")
    seen = set()
    in_chunks(lambda _: seen.add(threading.get_ident()))
    assert seen == {threading.get_ident()}
