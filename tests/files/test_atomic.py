"""Files that are written whole or not at all."""

import pytest

from evsdr.errors import InputError
from evsdr.files.atomic import atomic_folder, atomic_path, check_folder


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "events.h5"
    path.write_bytes(b"old")
    return path


def test_a_file_is_replaced_when_it_is_complete(path):
    with atomic_path(path) as temporary:
        assert (temporary.parent, temporary.suffix) == (path.parent, path.suffix)
        temporary.write_text("new")
        assert path.read_text() == "old"
    assert path.read_text() == "new"
    assert list(path.parent.iterdir()) == [path]


def test_failed_writing_keeps_the_old_file(path):
    before = path.read_bytes()
    with pytest.raises(RuntimeError), atomic_path(path) as temporary:
        assert temporary.suffix == path.suffix
        temporary.write_text("half")
        raise RuntimeError
    assert path.read_bytes() == before
    assert list(path.parent.iterdir()) == [path]


def test_a_place_that_does_not_exist_is_named(tmp_path):
    with pytest.raises(InputError, match=r"none/a: cannot be written \(No such file or directory\); choose"):
        with atomic_path(tmp_path / "none" / "a") as temporary:
            temporary.write_text("a")


def test_atomic_folder_moves_all_or_nothing(tmp_path):
    folder = tmp_path / "a" / "b"
    with pytest.raises(RuntimeError), atomic_folder(folder) as temporary:
        (temporary / "one").write_text("1")
        raise RuntimeError
    assert list(tmp_path.iterdir()) == []
    with atomic_folder(folder) as temporary:
        (temporary / "one").write_text("1")
        assert not (folder / "one").exists()
    assert [file.name for file in folder.iterdir()] == ["one"]
    with pytest.raises(InputError, match="one: cannot be written"), atomic_folder(folder / "one"):
        pass
    assert (folder / "one").read_text() == "1"


def test_files_of_other_names_stay(tmp_path):
    (tmp_path / "other").write_text("1")
    (tmp_path / "same").write_text("old")
    with atomic_folder(tmp_path) as temporary:
        (temporary / "same").write_text("new")
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {"other": "1", "same": "new"}


def test_a_folder_that_held_something_stays_on_failure(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "other").write_text("1")
    with pytest.raises(RuntimeError), atomic_folder(tmp_path / "a"):
        raise RuntimeError
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["other"]


def test_a_file_in_the_way_of_a_folder_is_named(path):
    check_folder(path.parent / "new" / "deep")
    for folder in (path, path / "deep"):
        with pytest.raises(InputError, match=r"events\.h5: a file of that name is in the way; .* --out\."):
            check_folder(folder)
