"""Engines run real fits in real workers, one of which is killed; the results are those of a clean run."""

import contextlib
import os
import signal
import sys
import threading

import numpy as np
import pytest

from evsdr.errors import InputError
from evsdr.files.maps import read_results
from evsdr.jobs import engines
from evsdr.jobs.rows import Row
from evsdr.jobs.run import run_rows

N_ROW, N_KILLED = 2, 1


@pytest.fixture(scope="module")
def clean(recorded, tmp_path_factory):
    """Give a function that runs rows in a folder of their own, and the maps of a run where nothing was killed."""

    def run(name, submit, n_job=2):
        folder = tmp_path_factory.mktemp(name)
        told = f"{recorded}/scene.xml", f"{recorded}/events.h5"
        rows = [
            Row(folder, *told, f"--preset fast --priors none --shared none --no-report --seed {k}", str(k))
            for k in range(N_ROW)
        ]
        outcomes = run_rows(rows, submit, n_job, lambda _: None)
        assert [outcome.state for outcome in outcomes] == ["done"] * N_ROW, outcomes
        return [read_results(row.results)[0] for row in rows], [outcome.tries for outcome in outcomes]

    with engines.local(1) as submit:
        return run, run("clean", submit)[0]


def same(found, expected):
    for one, other in zip(found, expected, strict=True):
        for name in ("normal", "reflectance", "mask", "normal_sigma_deg"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def killing(submit, kill):
    """Let the first fits be killed soon after their start."""
    n = 0

    def start(row):
        nonlocal n
        future, n = submit(row), n + 1
        if n <= N_KILLED:
            threading.Timer(0.7, kill, [future]).start()
        return future

    return start


@pytest.mark.slow
def test_local_processes_that_are_killed_run_again(clean):
    run, expected = clean
    with engines.local(1) as submit:
        found, tries = run("local", killing(submit, lambda future: future.process.kill()))
    same(found, expected)
    assert sum(tries) == N_ROW + N_KILLED


@pytest.mark.slow
def test_dask_gives_rows_of_a_killed_worker_to_another(clean):
    distributed = pytest.importorskip("distributed")
    run, expected = clean
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
        engines.dask(1, cluster.scheduler_address) as submit,
    ):
        pid = next(iter(client.run(os.getpid).values()))
        found, _ = run("dask", killing(submit, lambda _: os.kill(pid, signal.SIGKILL)))
        assert pid not in client.run(os.getpid).values()
    same(found, expected)


@pytest.mark.slow
def test_submitit_runs_rows_whose_job_is_killed_again(clean, tmp_path):
    pytest.importorskip("submitit")
    psutil = pytest.importorskip("psutil")
    run, expected = clean

    def kill_job(job):
        first = psutil.Process(job._process.pid)
        for process in (first, *first.children(recursive=True)):
            with contextlib.suppress(psutil.NoSuchProcess):  # the last may have ended with those before it
                process.kill()

    with engines.submitit(1, tmp_path, "local", ("timeout_min=5",)) as submit:
        found, tries = run("submitit", killing(submit, kill_job))
    same(found, expected)
    assert sum(tries) == N_ROW + N_KILLED


@pytest.mark.parametrize(
    ("engine", "module"),
    [
        (lambda folder: engines.dask(1, "tcp://x:1"), "distributed"),
        (lambda folder: engines.submitit(1, folder, "local", ()), "submitit"),
    ],
)
def test_an_engine_that_is_not_installed_is_a_sentence(engine, module, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, module, None)
    with (
        pytest.raises(InputError, match=r"not installed; install it: pip install 'evsdr\[batch\]'"),
        engine(tmp_path),
    ):
        pass


def test_what_an_engine_refuses_is_a_sentence(tmp_path):
    with pytest.raises(InputError, match="give its --address"), engines.dask(1, None):
        pass
    refused = engines.submitit(1, tmp_path, "local", ("nonsense=3",))
    with pytest.raises(InputError, match="submitit refuses this"), refused:
        pass
