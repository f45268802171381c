"""Fit recordings on each engine while workers of it are killed."""

import os
import signal
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from evsdr import read_results
from evsdr.jobs import engines
from evsdr.jobs.rows import Row
from evsdr.jobs.run import run_rows
from experiments.fitting import SCENES
from experiments.fitting import run as run_command

AFTER = 1.0, 1.5  # seconds after its start at which the worker of the first and of the second row is killed


@dataclass(frozen=True)
class Result:
    """A batch: rows that have results, tries of all, maps that differ from those of the clean run, wall time [s]."""

    done: int
    tries: int
    differ: int
    seconds: float


def run(n_fit: int, size: int, names: list[str]) -> Iterator[tuple[str, Result]]:
    """Fit recordings of a sphere on this machine undisturbed, then on each engine, two of whose workers are killed."""
    with tempfile.TemporaryDirectory() as folder:
        scene, define = str(SCENES / "sphere.xml"), ["-D", f"size={size}"]
        for k in range(n_fit):
            told = ["--ideal", "--rounds", "2", "--seed", str(k)]
            run_command("evsdr.simulate", [scene, "--out", f"{folder}/{k}", *define, *told])
        expected: list = []
        for name in ("clean", *names):
            rows = [_row(Path(folder), k, name, size) for k in range(n_fit)]
            with ENGINES.get(name, undisturbed)(Path(folder)) as submit:
                start = time.perf_counter()
                outcomes = run_rows(rows, submit, 2, lambda outcome: None)
                seconds = time.perf_counter() - start
            maps = [read_results(row.results)[0].normal for row in rows if row.summary()]
            expected = expected or maps
            same = sum(map(np.array_equal, maps, expected))
            done = sum(outcome.state.startswith("done") for outcome in outcomes)
            yield name, Result(done, sum(outcome.tries for outcome in outcomes), n_fit - same, seconds)


def _row(folder: Path, k: int, name: str, size: int) -> Row:
    options = f"-D size={size} --preset fast --no-report"
    return Row(folder, str(SCENES / "sphere.xml"), f"{k}/events.h5", options, f"{name}/{k}")


@contextmanager
def undisturbed(_: Path) -> Iterator[engines.Submit]:
    """Start fits on this machine."""
    with engines.local(1) as submit:
        yield submit


@contextmanager
def local(_: Path) -> Iterator[engines.Submit]:
    """Start fits on this machine; kill the processes of two."""
    with engines.local(1) as submit:
        yield _killing(submit, lambda future: future.process.kill())


@contextmanager
def dask(_: Path) -> Iterator[engines.Submit]:
    """Start a scheduler and workers as processes; kill two workers."""
    from distributed import Client, LocalCluster

    with (
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
        Client(cluster) as client,
        engines.dask(1, cluster.scheduler_address) as submit,
    ):
        pids = list(client.run(os.getpid).values())
        yield _killing(submit, lambda _: os.kill(pids.pop(), signal.SIGKILL))


@contextmanager
def submitit(folder: Path) -> Iterator[engines.Submit]:
    """Let submitit start processes of its own; kill two with all that they have started."""
    with engines.submitit(1, folder, "local", ("timeout_min=30",)) as submit:
        yield _killing(submit, lambda job: _kill_all(job._process.pid))


ENGINES = {"local": local, "dask": dask, "submitit": submitit}


def _kill_all(pid: int) -> None:
    import psutil

    first = psutil.Process(pid)
    for process in (first, *first.children(recursive=True)):
        process.kill()


def _killing(submit: engines.Submit, kill) -> engines.Submit:
    """Let the workers of the first rows be killed while they run."""
    delays = list(AFTER)

    def start(row: Row):
        future = submit(row)
        if delays:
            threading.Timer(delays.pop(0), kill, [future]).start()
        return future

    return start
