"""A process that talks to the ring, so that it is kept alive however busy the host's own process is.

The host opens the port, and starts this with the descriptors of the port and of a socket. Over the socket it
sends

    NAME PATIENCE_S COMMAND      and gets      NAME OK words | NAME ERR words | NAME LOST why

and, whenever the ring says so, `S SILENCE_MS OK words` (an answer to STATUS, and the longest time yet between
two lines to the ring), `# BOOT ...` (it has started) and `! why` (nothing has come for long). A request is sent
again when no answer has come for REPEAT_S. Once the ring has answered at all, STATUS goes out every BEAT_S,
whatever else is under way: from a thread of its own, since to look whether a port has something to read waits for
a worker of the kernel (tty_buffer_flush_work), which a busy computer lets wait. When the socket closes,
or the host has taken nothing for HOST_S, the process ends, and with its beats the light.
"""

import contextlib
import os
import select
import signal
import socket
import sys
import threading
import time
from collections import deque
from dataclasses import dataclass

from evsdr.rig.protocol import BEAT_S, LOST_S, REPEAT_S, Lines, frame

BEAT = "65535"  # the number of its requests
HOST_S = 10.0  # of a host that takes nothing more: it hangs, and the ring shall go dark
AGAIN_S = 0.002  # until a request is sent again when a line was spoiled
PRIORITY = 20  # of 1 to 99, among processes that go before all others
START = "import sys; sys.path[:] = {path!r}; from evsdr.rig.keeper import main; main()"


@dataclass
class Request:
    """What the host has asked, its number in the protocol, and when it is sent again and given up [s]."""

    name: str
    command: str
    patience_s: float
    number: str = ""
    again: float = 0.0
    end: float = 0.0


class Keeper:
    """Requests and beats over an open port.

    Parameters
    ----------
    port : int
        Descriptor of the port; reading and writing don't block.
    """

    def __init__(self, port: int):
        self._port, self._lines = port, Lines()
        self._waiting: deque[Request] = deque()
        self._current: Request | None = None
        self._number = 0
        self._met = self._is_lost = False
        self._heard = self._beaten = 0.0
        self._silence = 0.0  # the longest

    def ask(self, text: str) -> None:
        """Take a request of the host."""
        name, patience, command = text.split(" ", 2)
        self._waiting.append(Request(name, command, float(patience)))

    def timeout(self) -> float:
        """Give how long there is nothing to do but to listen [s]."""
        if not self._current:
            return 0.0 if self._waiting else 1.0
        return max(self._current.again - time.monotonic(), 0.0)

    def beat(self) -> None:
        """Keep the ring alive, once it has answered; for a thread that does nothing else."""
        if not self._met:
            return
        with contextlib.suppress(OSError):  # the other thread tells
            self._say(f"{BEAT} STATUS")
        now = time.monotonic()
        self._silence = max(self._silence, now - self._beaten)
        self._beaten = now

    def step(self, readable: bool) -> list[str]:
        """Do what is due; give the lines for the host."""
        try:
            told = self._listen() if readable else []
            self._speak(time.monotonic())
        except OSError as error:
            self._met = False
            return [*self._give_up(f"the port has gone ({error})"), f"! the port has gone ({error})"]
        now = time.monotonic()
        if self._current and now >= self._current.end:
            told += [f"{self._current.name} LOST no answer comes"]
            self._current = None
        if self._met and not self._is_lost and now - self._heard > LOST_S:
            self._is_lost = True
            told += ["! no answer comes"]
        return told

    def _give_up(self, why: str) -> list[str]:
        asked = [*([self._current] if self._current else []), *self._waiting]
        self._current = None
        self._waiting.clear()
        return [f"{request.name} LOST {why}" for request in asked]

    def _speak(self, now: float) -> None:
        if not self._current and self._waiting:
            self._number = self._number % 65534 + 1
            self._current = self._waiting.popleft()
            self._current.number, self._current.end = str(self._number), now + self._current.patience_s
        if self._current and now >= self._current.again:
            self._current.again = min(now + REPEAT_S, self._current.end)
            self._say(f"{self._current.number} {self._current.command}")

    def _say(self, text: str) -> None:
        """Send a line; the empty one before it ends what may have come on the way to the ring before."""
        with contextlib.suppress(BlockingIOError):  # the port takes no more: again, when it is due
            os.write(self._port, b"\n" + frame(text))

    def _listen(self) -> list[str]:
        told = []
        try:
            data = os.read(self._port, 4096)
        except BlockingIOError:
            return []
        if not data:
            raise OSError("it is closed")
        for text in self._lines.take(data):
            who, _, words = text.partition(" ")
            if who == "#":
                told += [text]
            elif who == "-" and self._current:
                self._current.again = min(self._current.again, time.monotonic() + AGAIN_S)
            elif who == BEAT:
                told += [f"S {1e3 * self._silence:.1f} {words}"]
            elif self._current and who == self._current.number:
                told += [f"{self._current.name} {words}"]
                self._current = None
            else:
                continue
            self._heard, self._is_lost = time.monotonic(), False
            self._begin()
        return told

    def _begin(self) -> None:
        if not self._met:
            self._met, self._beaten = True, time.monotonic()


def serve(port: int, host: socket.socket) -> None:
    """Keep the ring at a port alive until the host's socket closes."""
    keeper, rest, alive = Keeper(port), b"", True
    host.settimeout(HOST_S)
    threading.Thread(target=beat_on, args=(keeper,), daemon=True).start()
    while True:
        ready, _, _ = select.select([host, *([port] if alive else [])], [], [], keeper.timeout())
        if host in ready:
            data = host.recv(4096)
            if not data:
                return
            *lines, rest = (rest + data).split(b"\n")
            for line in lines:
                keeper.ask(line.decode())
        told = keeper.step(port in ready)
        alive = alive and not any(line.startswith("! the port") for line in told)
        if told:
            host.sendall("".join(f"{line}\n" for line in told).encode())


def beat_on(keeper: Keeper) -> None:
    """Beat for ever."""
    due = time.monotonic()
    while True:
        keeper.beat()
        now = time.monotonic()
        due = max(due + BEAT_S, now)
        time.sleep(due - now)


def go_first(priority: int = PRIORITY) -> None:
    """Run before all that can wait, where the system lets us: root, or whom limits.conf gives rtprio."""
    with contextlib.suppress(OSError, AttributeError):  # not on macOS
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(priority))


def main() -> None:
    """Run as a process; a signal to the whole group is the host's business."""
    go_first()
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        signal.signal(getattr(signal, name), signal.SIG_IGN)
    port, host = (int(word) for word in sys.argv[1:3])
    with contextlib.suppress(
        BrokenPipeError, ConnectionResetError, TimeoutError
    ):  # the host has gone, or hangs
        serve(port, socket.socket(fileno=host))
