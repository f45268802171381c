"""Kernels do not outlive the sources they were compiled of."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

import evsdr
from evsdr.stale import forget_stale

NUMBER = "HALF = {}\n"
INNER = "from numba import njit\nfrom small.number import HALF\n@njit(cache=True)\ndef inner(x):\n    return HALF * x\n"
OUTER = "from numba import njit\nfrom small.inner import inner\n@njit(cache=True)\ndef outer(x):\n    return inner(x) + 1\n"
OTHER = "NOTHING = 0\n"


@pytest.fixture
def small(tmp_path):
    """A package of a number, a kernel that holds it, and one that holds that."""
    package = tmp_path / "small"
    package.mkdir()
    for name, text in (
        ("__init__", ""),
        ("number", NUMBER.format(0.5)),
        ("inner", INNER),
        ("outer", OUTER),
        ("other", OTHER),
    ):
        (package / f"{name}.py").write_text(text)
    return package


def outer_of_2(package: Path) -> float:
    code = "from small.outer import outer; print(outer(2.0))"
    ended = subprocess.run(
        [sys.executable, "-c", code], cwd=package.parent, capture_output=True, text=True, check=True
    )
    return float(ended.stdout)


def change(package: Path, name: str, text: str) -> None:
    """Write a source anew, a minute after all that there is, which is older then."""
    for path in package.rglob("*.*"):
        then = path.stat().st_mtime - 60
        os.utime(path, (then, then))
    (package / f"{name}.py").write_text(text)


def test_a_number_that_changes_takes_the_kernels_with_it(small):
    assert outer_of_2(small) == 2 and outer_of_2(small) == 2
    assert forget_stale(small) == []
    change(small, "number", NUMBER.format(2.0))
    assert outer_of_2(small) == 2  # numba itself does not see it
    removed = forget_stale(small)
    assert {index.name.partition(".")[0] for index in removed} == {"inner", "outer"}
    assert not list(small.rglob("*.nbi")) and not list(small.rglob("*.nbc"))
    assert outer_of_2(small) == 5


def test_other_sources_take_none(small):
    outer_of_2(small)
    change(small, "other", OTHER)
    assert forget_stale(small) == [] and len(list(small.rglob("*.nbi"))) == 2


def test_a_source_of_tomorrow_takes_none(small):
    """Else it would until then, at every import."""
    outer_of_2(small)
    os.utime(small / "inner.py", (time.time() + 86400,) * 2)
    assert forget_stale(small) == []


def test_kernels_that_another_process_removes_meanwhile_are_none_of_ours(small, monkeypatch):
    """Two that start together after an update both look, and each removes what the other has listed."""
    outer_of_2(small)
    change(small, "number", NUMBER.format(2.0))
    listed = list(small.rglob("*.nbi"))
    gone = listed[0]
    gone.unlink()
    found = Path.rglob
    monkeypatch.setattr(Path, "rglob", lambda at, what: listed if "nbi" in what else found(at, what))
    assert set(forget_stale(small)) == set(listed) - {gone}


def test_without_kernels_there_is_nothing_to_do(small):
    assert forget_stale(small) == []


def test_the_package_itself_has_none():
    """It looks as it is imported."""
    assert forget_stale(Path(evsdr.__file__).parent) == []
