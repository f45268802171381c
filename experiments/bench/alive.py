"""How well the ring is kept alive by a busy computer: on the simulated chip, at the pace of a real one.

The chip's time is the wall's: the bench runs before all else where the system lets it, and tells how late it was
at worst. The host measures on its own how long the ring heard nothing, as its lines leave it.
"""

import contextlib
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import dataclass

from evsdr.rig.driver import Ring, RingSettings
from experiments.bench.simulator import beside_host

SLOT_US = 10_000


@dataclass(frozen=True)
class Run:
    """How a run went.

    Attributes
    ----------
    ended : str
        As the host's log says.
    silence_ms : float
        The longest time between two lines to the ring.
    late_ms : float
        How late the simulated chip was at worst.
    """

    ended: str
    silence_ms: float
    late_ms: float


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


def run_beside(seconds: float, n_process: int) -> Run:
    """Run the ring for some seconds while others compute."""
    rounds = max(round(seconds * 1e6 / (24 * SLOT_US)), 1)
    late: list[str] = []
    with beside_host(real=True, last=late) as (port, bench):
        with contextlib.suppress(OSError, AttributeError):  # only root may, on Linux
            os.sched_setscheduler(bench.pid, os.SCHED_FIFO, os.sched_param(10))
        with busy(n_process), Ring(port) as ring:
            log = ring.run(RingSettings(slot_us=SLOT_US, rounds=rounds))
            silence_ms = ring.silence_ms
    return Run(log.ended, silence_ms, float(late[0].split(" ")[-2]))
