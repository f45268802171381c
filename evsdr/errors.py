"""What goes wrong with input, as plain sentences, and checks that many share."""

import math
import shlex
import sys
from pathlib import Path


class InputError(Exception):
    """Input that can't be used.

    The message is one plain sentence that names file, field and remedy. The commands print it on
    standard error and exit with 2.
    """


class InputWarning(UserWarning):
    """Input that can be used, with something the user should know; one plain sentence."""


def parse_definitions(define: tuple[str, ...]) -> dict[str, str]:
    """Read `name=value` pairs for the `<default>` parameters of a scene file."""
    pairs = [text.partition("=") for text in define]
    for name, equals, value in pairs:
        if not name or not equals:
            raise InputError(f"-D {name}{equals}{value}: write it as -D name=value.")
    return {name: value for name, _, value in pairs}


def check_range(name: str, value: int, least: int, most: int = 2**32 - 1) -> None:
    """Refuse a number outside a range.

    Raises
    ------
    InputError
        It is.
    """
    if not least <= value <= most:
        raise InputError(f"{name} is {value}; give a whole number from {least} to {most}.")


def free_memory() -> float:
    """Give the memory that is free [bytes] for this process; infinite where the system does not tell."""
    return min(_of_machine(), free_address_space(), _of_container())


def _of_machine() -> float:
    try:
        rows = dict(line.split(":") for line in Path("/proc/meminfo").read_text("ascii").splitlines())
        return 1024.0 * int(rows["MemAvailable"].split()[0])
    except (OSError, ValueError, KeyError):
        return math.inf


def free_address_space() -> float:
    """Give what `ulimit -v` leaves [bytes]; libraries and threads reserve more of it than they use."""
    try:
        import resource  # not on Windows

        limit, _ = resource.getrlimit(resource.RLIMIT_AS)
        used = int(Path("/proc/self/statm").read_text("ascii").split()[0]) * resource.getpagesize()
        return math.inf if limit == resource.RLIM_INFINITY else max(limit - used, 0.0)
    except (ImportError, OSError, ValueError):
        return math.inf


def _of_container(folder: Path = Path("/sys/fs/cgroup")) -> float:
    """Give what the limit of a control group leaves; files that are only cached count as free."""
    try:
        limit, used = (int((folder / f"memory.{name}").read_text("ascii")) for name in ("max", "current"))
        rows = dict(line.split() for line in (folder / "memory.stat").read_text("ascii").splitlines())
        return max(limit - used + float(rows["inactive_file"]), 0.0)
    except (OSError, ValueError, KeyError):  # a limit of `max` is none
        return math.inf


def check_memory(what: str, n_bytes: float, remedy: str) -> None:
    """Refuse work that needs more memory than is free, before it starts.

    Raises
    ------
    InputError
        It does.
    """
    free = free_memory()
    if n_bytes > free:
        raise InputError(
            f"{what} would need {n_bytes / 2**30:.3g} GiB of memory, but {free / 2**30:.3g} GiB are free; {remedy}."
        )


def check_address_space(what: str, n_bytes: float) -> None:
    """Refuse work that needs more address space than this process may take, before it starts.

    Where a library or a thread finds none, the C library may end the process.

    Raises
    ------
    InputError
        It does.
    """
    free = free_address_space()
    if n_bytes > free:
        raise InputError(
            f"{what} would need {n_bytes / 2**30:.3g} GiB of address space, but {free / 2**30:.3g} GiB are left "
            "to this process; raise its limit, as by `ulimit -v unlimited`."
        )


def lacking(package: str) -> str:
    """Say in a sentence that this Python lacks a package, and which one has it or how it gets it."""
    root, python = Path(__file__).resolve().parents[1], shlex.quote(sys.executable)
    ready, project = root / ".venv" / "bin" / "activate", root / "pyproject.toml"
    remedy = f"type {python} -m pip install {shlex.quote(str(root)) if project.exists() else 'evsdr'}"
    if ready.exists() and Path(sys.prefix).resolve() != root / ".venv":
        remedy = f"type . {shlex.quote(str(ready))} first"
    return f"{sys.executable} has no package {package}; {remedy}."
