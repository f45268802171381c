"""Checks that many commands share."""

import math

import pytest

from evsdr import errors
from evsdr.errors import (
    InputError,
    check_address_space,
    check_memory,
    check_range,
    free_memory,
    parse_definitions,
)


def test_definitions():
    assert parse_definitions(()) == {}
    assert parse_definitions(("a=1", "b=x=y", "c=", "a=2")) == {"a": "2", "b": "x=y", "c": ""}


@pytest.mark.parametrize("text", ["a", "=1", "=", ""])
def test_bad_definition(text):
    with pytest.raises(InputError, match=f"^-D {text}: write it as -D name=value.$"):
        parse_definitions(("b=1", text))


@pytest.mark.parametrize("value", [1, 2**32 - 1])
def test_number_in_range(value):
    check_range("--n", value, 1)


@pytest.mark.parametrize("value", [0, -5, 2**32])
def test_number_out_of_range(value):
    with pytest.raises(InputError, match=f"^--n is {value}; give a whole number from 1 to 4294967295.$"):
        check_range("--n", value, 1)


def test_limits_of_a_process_and_of_a_container_count(tmp_path, monkeypatch):
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_AS)
    monkeypatch.setattr(resource, "getrlimit", lambda which: (1 << 50, 1 << 50))
    assert (1 << 49) < errors.free_address_space() < (1 << 50)
    assert free_memory() < 1 << 49 and resource.getrlimit(0) != before
    for name, text in (("max", "3000\n"), ("current", "1000\n"), ("stat", "file 300\ninactive_file 200\n")):
        (tmp_path / f"memory.{name}").write_text(text)
    assert errors._of_container(tmp_path) == 2200
    (tmp_path / "memory.max").write_text("max\n")
    assert errors._of_container(tmp_path) == math.inf


def test_work_beyond_the_free_memory_is_refused(monkeypatch):
    assert free_memory() > 1 << 20
    monkeypatch.setattr(errors, "free_memory", lambda: 2.0**31)
    check_memory("it", 2**31, "make it smaller")
    with pytest.raises(
        InputError, match="^it would need 4 GiB of memory, but 2 GiB are free; make it smaller.$"
    ):
        check_memory("it", 2**32, "make it smaller")


def test_work_beyond_the_address_space_is_refused(monkeypatch):
    monkeypatch.setattr(errors, "free_address_space", lambda: 2.0**31)
    check_address_space("it", 2**31)
    with pytest.raises(InputError, match="^it would need 4 GiB of address space, but 2 GiB are left to this"):
        check_address_space("it", 2**32)
