"""`python -m evsdr.batch jobs.csv`: many fits, each in a process of its own."""

from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from evsdr.commands.console import print_table, run_command
from evsdr.errors import check_range
from evsdr.files.atomic import check_folder
from evsdr.jobs import engines
from evsdr.jobs.rows import Row, read_rows
from evsdr.jobs.run import Outcome, run_rows, write_table

WITHOUT = 1  # exit status where rows have no results
MOST = 1000  # rows at a time that an engine of many machines is given


@dataclass(frozen=True)
class Options:
    """Run many fits, each in a process of its own. Rows that have results are skipped; one table tells of all."""

    jobs: tyro.conf.Positional[Path]
    """CSV file: a row is a fit, with columns scene, events, options, out. Paths begin in its folder."""
    executor: Literal["local", "dask", "submitit"] = "local"
    """What runs them: this machine, the workers of a Dask scheduler, or a cluster (Slurm) by submitit."""
    at_once: int | None = None
    """Most fits at a time; by default, on this machine, one for every two cores, else as many as the engine takes."""
    threads: int | None = None
    """Threads of each fit; by default, on this machine, its cores shared among fits, else 1."""
    address: str | None = None
    """Of the Dask scheduler, as tcp://host:8786."""
    cluster: Literal["slurm", "local"] | None = None
    """Where submitit runs fits; by default on Slurm if it is there."""
    with_: Annotated[tuple[str, ...], tyro.conf.arg(name="with"), tyro.conf.UseAppendAction] = field(
        default=()
    )
    """name=value for submitit, as slurm_partition=short, timeout_min=30; may be repeated."""
    table: Path | None = None
    """CSV file that tells how each row ended; by default beside the jobs, jobs.results.csv."""


def main(argv: list[str] | None = None) -> int:
    """Run the command; gives its exit status."""
    return run_command("batch", Options, command, argv)


def command(options: Options) -> int:
    """Run the rows, write the table; gives 1 if some have no results."""
    rows = read_rows(options.jobs)
    table = options.table or options.jobs.with_suffix(".results.csv")
    check_folder(table.parent)
    n_job, n_thread = shares(options, len(rows))
    done: list[Outcome] = []

    def tell(outcome: Outcome) -> None:
        done.append(outcome)
        why = outcome.said or outcome.verdict.partition(":")[0]
        print(f"{len(done)} of {len(rows)}, {outcome.out}: {outcome.state}{why and f', {why}'}", flush=True)

    with engine(options, n_thread, rows) as submit:
        outcomes = run_rows(rows, submit, n_job, tell)
    write_table(table, outcomes)
    states = [outcome.state for outcome in outcomes]
    print_table(str(table), [(state, str(states.count(state))) for state in dict.fromkeys(states)])
    return 0 if all(state.startswith("done") for state in states) else WITHOUT


def shares(options: Options, n_row: int) -> tuple[int, int]:
    """Give how many fits run at a time, and the threads of each: together the cores, unless asked otherwise."""
    for name in ("at_once", "threads"):
        asked = getattr(options, name)
        if asked is not None:
            check_range(f"--{name.replace('_', '-')}", asked, 1)
    if options.executor != "local":
        return options.at_once or MOST, options.threads or 1
    cores = engines.cores()
    wanted = cores // options.threads if options.threads else (cores + 1) // 2
    n_job = options.at_once or max(1, min(n_row, wanted))
    return n_job, options.threads or max(1, cores // n_job)


def engine(options: Options, n_thread: int, rows: list[Row]) -> AbstractContextManager[engines.Submit]:
    """Open the engine that is asked for."""
    if options.executor == "dask":
        return engines.dask(n_thread, options.address)
    if options.executor == "submitit":
        return engines.submitit(n_thread, rows[0].folder, options.cluster, options.with_)
    return engines.local(n_thread)
