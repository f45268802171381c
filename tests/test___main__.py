"""`python -m evsdr` lists the commands."""

import subprocess
import sys

from evsdr.__main__ import listing
from tests.conftest import REPOSITORY


def test_each_command_is_listed_with_what_it_does():
    lines = [line.split(maxsplit=3) for line in listing().splitlines()]
    commands, doors = (
        {path.stem for path in (REPOSITORY / folder).glob("*.py")} for folder in ("evsdr/commands", "evsdr")
    )
    assert sorted(line[2] for line in lines) == sorted(
        f"evsdr.{name}" for name in commands & doors - {"__init__"}
    )
    assert all(line[:2] == ["python", "-m"] and len(line[3]) > 10 for line in lines)


def test_it_needs_no_package():
    """Run by a Python that sees the standard library only."""
    command = [sys.executable, "-I", "-S", "-c"]
    code = f"import sys, runpy; sys.path.insert(0, {str(REPOSITORY)!r}); runpy.run_module('evsdr', run_name='__main__')"
    done = subprocess.run([*command, code], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "") and listing() in done.stdout
