"""The host's end of the process that talks to the ring."""

import contextlib
import queue
import socket
import subprocess
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass

import serial

from evsdr.rig import protocol
from evsdr.rig.keeper import START
from evsdr.rig.protocol import Answer, RingLost, parse

MARGIN_S = 2.0  # after its patience the process must have said something


@dataclass(frozen=True)
class Heard:
    """What is called, from another thread, with what the ring says unasked.

    Attributes
    ----------
    status : callable (Answer)
        Its state, many times a second.
    boot : callable (str)
        It has started; its own words.
    lost : callable (str)
        It says nothing any more; why.
    """

    status: Callable[[Answer], None]
    boot: Callable[[str], None]
    lost: Callable[[str], None]


class Link:
    """Requests and answers over an open port, which is kept alive; may be used from several threads.

    Parameters
    ----------
    port : serial.Serial
        Open; the other process reads and writes it.
    heard : Heard
        Who listens.

    Attributes
    ----------
    silence_ms : float
        The longest time yet between two lines to the ring.
    """

    def __init__(self, port: serial.Serial, heard: Heard):
        self.silence_ms = 0.0
        self._heard, self._lock, self._name = heard, threading.Lock(), 0
        self._answers: queue.Queue[str] = queue.Queue()
        self._socket, other = socket.socketpair()
        with other:
            descriptors = (port.fileno(), other.fileno())
            self._process = subprocess.Popen(
                [sys.executable, "-I", "-S", "-c", START.format(path=sys.path), *map(str, descriptors)],
                pass_fds=descriptors,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                start_new_session=True,  # Linux shares the processor out by sessions: this has one of its own
            )
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def ask(self, command: str, patience_s: float | None = None) -> Answer:
        """Send a command until it is answered.

        Parameters
        ----------
        command : str
            Name and arguments.
        patience_s : float, optional
            When to give up [s]; by default after LOST_S.

        Raises
        ------
        RingLost
            No answer came.
        RingRefused
            The answer is ERR.
        """
        patience = protocol.LOST_S if patience_s is None else patience_s
        with self._lock:
            self._name += 1
            try:
                self._socket.sendall(f"{self._name} {patience:.3f} {command}\n".encode())
                words = self._answer(str(self._name), patience + MARGIN_S)
            except (OSError, queue.Empty) as error:
                raise RingLost("the process that talks to it has gone") from error
        if words.startswith("LOST "):
            raise RingLost(words.removeprefix("LOST "))
        return parse(words)

    def _answer(self, name: str, patience_s: float) -> str:
        while True:
            who, _, words = self._answers.get(timeout=patience_s).partition(" ")
            if who == name:
                return words

    def close(self) -> None:
        """End the process; the ring is silent from now on."""
        with contextlib.suppress(OSError):  # it has gone already
            self._socket.shutdown(socket.SHUT_RDWR)
        self._process.wait()
        self._thread.join()
        self._socket.close()

    def _listen(self) -> None:
        with contextlib.suppress(OSError), self._socket.makefile(encoding="utf-8") as lines:
            for line in lines:
                self._take(line.rstrip("\n"))
        self._answers.put(f"{self._name} LOST the process that talks to it has gone")
        self._heard.lost("the process that talks to it has gone")

    def _take(self, line: str) -> None:
        who, _, words = line.partition(" ")
        if who == "S":
            silence, _, words = words.partition(" ")
            self.silence_ms = float(silence)
            if words.startswith("OK "):
                self._heard.status(parse(words))
        elif who == "#":
            self._heard.boot(words)
        elif who == "!":
            self._heard.lost(words)
        else:
            self._answers.put(line)
