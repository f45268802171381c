"""Files that are written whole or not at all."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from evsdr.errors import InputError
from evsdr.files import atomic
from evsdr.files.atomic import atomic_folder, atomic_path, check_folder
from tests.conftest import REPOSITORY


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


def test_the_seal_goes_first_and_comes_last(tmp_path, monkeypatch):
    """Killed between two files, the folder has no seal: nobody takes old and new ones for one result."""
    for name in ("maps", "summary"):
        (tmp_path / name).write_text("old")
    moved = []

    def replace(source, target):
        moved.append(target.name)
        if len(moved) == 2:
            raise SystemExit  # as good as killed
        real(source, target)

    real = os.replace
    monkeypatch.setattr(os, "replace", replace)
    with pytest.raises(SystemExit), atomic_folder(tmp_path, "summary") as temporary:
        for name in ("summary", "maps"):
            (temporary / name).write_text("new")
    assert moved == ["maps", "summary"] and not (tmp_path / "summary").exists()


def test_what_a_killed_process_left_is_cleaned_up(tmp_path):
    program = (
        "import os, signal; from evsdr.files.atomic import atomic_folder\n"
        f"with atomic_folder({str(tmp_path)!r}) as temporary:\n"
        "    (temporary / 'half').write_text('a'); os.kill(os.getpid(), signal.SIGKILL)"
    )
    subprocess.run([sys.executable, "-c", program], cwd=REPOSITORY)
    (left,) = tmp_path.iterdir()
    assert left.is_dir() and left.name.startswith(".")
    with atomic_folder(tmp_path) as temporary:
        (temporary / "whole").write_text("a")
    assert [path.name for path in tmp_path.iterdir()] == ["whole"]


def test_two_do_not_write_into_one_folder(tmp_path, monkeypatch):
    monkeypatch.setattr(atomic, "PATIENCE", 0.2)
    with atomic_folder(tmp_path), pytest.raises(InputError, match="another process writes into this folder"):
        with atomic_folder(tmp_path):
            pytest.fail("both are in")
    with atomic_folder(tmp_path) as temporary:
        (temporary / "a").write_text("a")
    assert (tmp_path / "a").exists()


def test_ctrl_c_waits_while_files_move(tmp_path, monkeypatch):
    real = os.replace

    def replace(source, target):
        os.kill(os.getpid(), signal.SIGINT)
        real(source, target)

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        monkeypatch.setattr(os, "replace", replace)
        with pytest.raises(KeyboardInterrupt), atomic_folder(tmp_path, "a") as temporary:
            for name in "ab":
                (temporary / name).write_text(name)
    finally:
        signal.signal(signal.SIGINT, before)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b"]


@pytest.mark.skipif(not os.path.isdir("/proc"), reason="a folder that not even the super-user may write")
def test_a_folder_that_can_not_be_written_is_refused_early():
    with pytest.raises(InputError, match=r"^/proc/new/deep: cannot be written \(.*\); choose another"):
        check_folder(Path("/proc/new/deep"))
