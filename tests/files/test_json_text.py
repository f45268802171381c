"""JSON files that others wrote."""

import pytest

from evsdr.errors import InputError
from evsdr.files import json_text
from evsdr.files.json_text import read_json


def test_what_it_holds_is_read(tmp_path):
    (tmp_path / "a.json").write_text('{"a": [1, "ü"]}', encoding="utf-8")
    assert read_json(tmp_path / "a.json", "it") == {"a": [1, "ü"]}


@pytest.mark.parametrize(
    "content, says",
    [
        (b"", "not JSON; name the log"),
        (b"\xff\xfe{}", "not JSON"),
        (b"[" * 100_000, "not JSON"),
        (b'{"a": ' + b"9" * 5000 + b"}", "not JSON"),
        (b'{"a": -' + b"9" * 400 + b"}", "not JSON"),
    ],
)
def test_faults_become_a_sentence(tmp_path, content, says):
    (tmp_path / "a.json").write_bytes(content)
    with pytest.raises(InputError, match=says):
        read_json(tmp_path / "a.json", "the log")


def test_missing_files_folders_and_large_files_are_refused(tmp_path, monkeypatch):
    for path in (tmp_path / "none.json", tmp_path):
        with pytest.raises(InputError, match="no readable file; name the log"):
            read_json(path, "the log")
    monkeypatch.setattr(json_text, "LARGEST", 3)
    (tmp_path / "a.json").write_text('{"a": 1}')
    with pytest.raises(InputError, match="larger than"):
        read_json(tmp_path / "a.json", "the log")
