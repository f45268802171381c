"""Write files so that nothing half-written ever stands under its final name."""

import os
import secrets
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import mkdtemp

from evsdr.errors import InputError
from evsdr.signals import undisturbed

try:
    import fcntl
except ImportError:  # not on Windows
    fcntl = None

PREFIX = ".evsdr-"  # of temporary folders
PATIENCE = 20.0  # seconds that a process waits for another that writes


@contextmanager
def atomic_path(path: str | Path) -> Iterator[Path]:
    """Give a temporary path beside `path`, with its suffix; rename it on success, remove it on failure.

    Parameters
    ----------
    path : str or Path
        Where the file shall be; replaced if it exists.

    Raises
    ------
    InputError
        The file can't be written there.
    """
    path = Path(path)
    temporary = path.with_name(f".{path.stem}.{secrets.token_hex(4)}{path.suffix}")
    try:
        yield temporary
        os.replace(temporary, path)
    except OSError as error:
        raise _unwritable(path, error) from error
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def atomic_folder(folder: str | Path, seal: str | None = None) -> Iterator[Path]:
    """Give a temporary folder; its files move into `folder` on success and vanish on failure.

    One process at a time: others wait. What a killed one has left is cleaned up by the next.

    Parameters
    ----------
    folder : str or Path
        Made if missing; other files in it stay, files of the same name are replaced.
    seal : str, optional
        The file that goes first of the old ones and comes last of the new: where it is, all belong together, even if
        the process was killed.

    Raises
    ------
    InputError
        The folder can't be made or written, or another process does not end to write into it.
    """
    folder = Path(folder)
    made: list[Path] = []
    try:
        for level in (*reversed(folder.parents), folder):
            if not level.exists():
                level.mkdir()
                made.append(level)
        with _alone(folder):
            for left in folder.glob(f"{PREFIX}*"):
                shutil.rmtree(left, ignore_errors=True)
            temporary = Path(mkdtemp(prefix=PREFIX, dir=folder))
            try:
                yield temporary
                with undisturbed():
                    _move(temporary, folder, seal)
            finally:
                shutil.rmtree(temporary, ignore_errors=True)
    except BaseException as error:
        for level in reversed(made):
            if not any(level.iterdir()):
                level.rmdir()
        if isinstance(error, OSError):
            raise _unwritable(folder, error) from error
        raise


def _move(temporary: Path, folder: Path, seal: str | None) -> None:
    """Move all files, those of its folders too, that of the seal last; the old one goes before."""
    names = [file.relative_to(temporary) for file in temporary.rglob("*") if file.is_file()]
    if seal:
        (folder / seal).unlink(missing_ok=True)
    for name in sorted(names, key=lambda name: (str(name) == seal, name)):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        os.replace(temporary / name, folder / name)


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Keep other processes from a folder; where the system has no locks, hope."""
    if fcntl is None:
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        end = time.monotonic() + PATIENCE
        while True:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if time.monotonic() > end:
                    raise InputError(
                        f"{folder}: another process writes into this folder; wait for it, or give another by --out."
                    ) from None
                time.sleep(0.05)
            except OSError:  # a file system without locks
                break
        yield
    finally:
        os.close(handle)


def check_folder(folder: Path) -> None:
    """Refuse early a folder that can't become one, or be written.

    Raises
    ------
    InputError
        A file of that name is in the way, or it can't be written.
    """
    levels = [level for level in (folder, *folder.absolute().parents) if level.exists()]
    for level in levels:
        if not level.is_dir():
            raise InputError(f"{level}: a file of that name is in the way; give another folder by --out.")
    try:
        os.rmdir(
            mkdtemp(prefix=PREFIX, dir=levels[0])
        )  # asking would not do: the super-user may write anywhere
    except OSError as error:
        raise _unwritable(folder, error) from error


def _unwritable(path: Path, error: OSError) -> InputError:
    reason = os.strerror(error.errno) if error.errno else str(error).splitlines()[0]
    return InputError(f"{path}: cannot be written ({reason}); choose another place or make room there.")
