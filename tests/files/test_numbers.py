"""Tables of numbers that others wrote."""

import numpy as np
import pytest

from evsdr.errors import InputError
from evsdr.files import numbers
from evsdr.files.numbers import read_numbers


def test_a_table_is_read(tmp_path):
    (tmp_path / "a.csv").write_text("\ufeffx,y\n# a note\n1,2\n3,4\n", encoding="utf-8")
    table = read_numbers(tmp_path / "a.csv", "no table")
    assert np.isnan(table[0]).all() and table[1:].tolist() == [[1, 2], [3, 4]]


@pytest.mark.parametrize("content", [b"", b"\n", b"# only\n", b"1,2\n3\n", b"\xff\xfe1,2", b"\x00"])
def test_what_is_none_is_said(tmp_path, content):
    (tmp_path / "a.csv").write_bytes(content)
    try:
        assert np.isnan(read_numbers(tmp_path / "a.csv", "no table; write one")).all()
    except InputError as error:
        assert str(error) == f"{tmp_path / 'a.csv'}: no table; write one."


def test_missing_and_large_files_are_refused(tmp_path, monkeypatch):
    with pytest.raises(InputError, match="no table"):
        read_numbers(tmp_path, "no table")
    monkeypatch.setattr(numbers, "LARGEST", 2)
    (tmp_path / "a.csv").write_text("1,2\n")
    with pytest.raises(InputError, match="no table"):
        read_numbers(tmp_path / "a.csv", "no table")
