"""How well the ring is kept alive by a busy computer, in the time of its own kernel.

The ring is a stand-in at a socket, which gets each line in the instant in which it is written, as a USB controller does; a
terminal would pass it on by a worker of the kernel, which itself waits on a busy computer. A real port adds up to a millisecond.
"""

import contextlib
import ctypes
import json
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from types import SimpleNamespace

from evsdr.rig import driver

SLOT_US = 10_000
ROUND_S = 24e-6 * SLOT_US
PR_CAPBSET_DROP, CAP_SYS_NICE = 24, 23


@dataclass(frozen=True)
class Run:
    """How a run went.

    Attributes
    ----------
    ended : str
        As the host's log says.
    silence_ms : float
        The longest time between two lines at the ring.
    sent_ms : float
        The longest time between two lines that the host sent.
    late_ms : float
        How late the stand-in was at worst.
    """

    ended: str
    silence_ms: float
    sent_ms: float
    late_ms: float


@contextlib.contextmanager
def stand_in() -> Iterator[tuple[socket.socket, dict]]:
    """Run a stand-in; gives the port to it, and what it tells in the end."""
    port, other = socket.socketpair()
    port.setblocking(False)
    command = [sys.executable, "-m", "experiments.bench.stand_in", str(other.fileno()), str(ROUND_S)]
    pipes: dict = dict(stdin=subprocess.PIPE, stdout=subprocess.PIPE, pass_fds=(other.fileno(),))
    told: dict = {}
    with port, subprocess.Popen(command, text=True, **pipes) as process:
        other.close()
        try:
            yield port, told
            process.stdin.close()
            told |= json.loads(process.stdout.readline())
        finally:
            process.kill()


@contextlib.contextmanager
def busy(n_process: int) -> Iterator[None]:
    """Keep the computer busy, and this process's interpreter, too."""
    done = threading.Event()
    worker = threading.Thread(target=lambda: _count(done))
    others = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(n_process)]
    worker.start()
    try:
        yield
    finally:
        done.set()
        worker.join()
        for other in others:
            other.kill()
            other.wait()


def _count(done: threading.Event) -> None:
    n = 0
    while not done.is_set():
        n += 1


def run_beside(seconds: float, n_process: int, as_user: bool = False) -> Run:
    """Run the ring for some seconds while others compute, from a process of its own.

    Parameters
    ----------
    seconds : float
        Length of the run.
    n_process : int
        How many others compute.
    as_user : bool
        As somebody has it whom the system does not let go before others.
    """
    command = [
        sys.executable,
        "-m",
        "experiments.bench.alive",
        str(seconds),
        str(n_process),
        str(int(as_user)),
    ]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    return Run(**json.loads(done.stdout))


def main() -> None:
    """Run as that process."""
    seconds, n_process, as_user = (float(word) for word in sys.argv[1:])
    with stand_in() as (port, told):
        if as_user:  # what is started from now on may not go before others
            ctypes.CDLL(None).prctl(PR_CAPBSET_DROP, CAP_SYS_NICE, 0, 0, 0)
        driver.serial.Serial = lambda *_, **__: SimpleNamespace(fileno=port.fileno, close=lambda: None)
        with busy(int(n_process)), driver.Ring("") as ring:
            log = ring.run(driver.RingSettings(slot_us=SLOT_US, rounds=max(round(seconds / ROUND_S), 1)))
            sent_ms = ring.silence_ms
    print(json.dumps(asdict(Run(log.ended, told["silence_ms"], sent_ms, told["late_ms"]))))


if __name__ == "__main__":
    main()
