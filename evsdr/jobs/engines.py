"""What starts fits: this machine, the workers of a Dask scheduler, or a cluster by submitit (Slurm)."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol

from evsdr.errors import InputError
from evsdr.jobs.process import Ended, Fitting, fit_row
from evsdr.jobs.rows import Row

LOGS = ".evsdr-batch"  # folder of submitit's logs, beside the table
PATIENCE = 10.0  # seconds until a scheduler must answer


class Future(Protocol):
    """What all engines give for a row that they were given."""

    def done(self) -> bool: ...

    def result(self) -> Ended: ...

    def cancel(self) -> None: ...


Submit = Callable[[Row], Future]


@contextmanager
def local(n_thread: int) -> Iterator[Submit]:
    """Start fits on this machine."""
    yield lambda row: Fitting(row, n_thread)


@contextmanager
def dask(n_thread: int, address: str | None) -> Iterator[Submit]:
    """Give fits to the workers of a Dask scheduler; they must see the files under the same paths.

    Parameters
    ----------
    address : str
        Of the scheduler, as tcp://host:8786.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise absent("dask.distributed") from error
    if not address:
        raise InputError("--executor dask needs a scheduler; give its --address, as tcp://host:8786.")
    try:
        client = Client(address, set_as_default=False, timeout=PATIENCE)
    except (OSError, ValueError) as error:
        raise InputError(f"{address}: no Dask scheduler answers; start one by: dask scheduler.") from error
    with client:
        yield lambda row: client.submit(fit_row, row, n_thread, pure=False)


@contextmanager
def submitit(
    n_thread: int, folder: Path, cluster: str | None, parameters: tuple[str, ...]
) -> Iterator[Submit]:
    """Give fits to a cluster, by submitit.

    Parameters
    ----------
    folder : Path
        Where its logs shall lie: all machines see it.
    cluster : str, optional
        `slurm`, or `local` for processes on this machine; by default Slurm where it is.
    parameters : sequence of str
        name=value for submitit, as slurm_partition=short, timeout_min=30.
    """
    try:
        from submitit import AutoExecutor
    except ImportError as error:
        raise absent("submitit") from error
    pairs = [text.partition("=")[::2] for text in parameters]
    try:
        executor = AutoExecutor(folder / LOGS / "%j", cluster=cluster)
        executor.update_parameters(
            **{"cpus_per_task": n_thread}
            | {name: int(value) if value.isdigit() else value for name, value in pairs}
        )
    except (RuntimeError, ValueError, NameError, TypeError, AssertionError) as error:
        raise InputError(
            f"submitit refuses this ({' '.join(str(error).split())}); change --cluster or --with."
        ) from error
    yield lambda row: executor.submit(fit_row, row, n_thread)


def absent(name: str) -> InputError:
    """Say that an engine is not installed."""
    return InputError(f"{name} is not installed; install it: pip install 'evsdr[batch]'.")


def cores() -> int:
    """Count the cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
