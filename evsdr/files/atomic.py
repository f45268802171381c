"""Write files so that nothing half-written ever stands under its final name."""

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from evsdr.errors import InputError


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
def atomic_folder(folder: str | Path) -> Iterator[Path]:
    """Give a temporary folder; its files move into `folder` on success and vanish on failure.

    Parameters
    ----------
    folder : str or Path
        Made if missing; other files in it stay, files of the same name are replaced.

    Raises
    ------
    InputError
        The folder can't be made or written.
    """
    folder = Path(folder)
    made: list[Path] = []
    try:
        for level in (*reversed(folder.parents), folder):
            if not level.exists():
                level.mkdir()
                made.append(level)
        with TemporaryDirectory(prefix=".", dir=folder) as temporary:
            yield Path(temporary)
            for file in sorted(Path(temporary).iterdir()):
                os.replace(file, folder / file.name)
    except BaseException as error:
        for level in reversed(made):
            if not any(level.iterdir()):
                level.rmdir()
        if isinstance(error, OSError):
            raise _unwritable(folder, error) from error
        raise


def check_folder(folder: Path) -> None:
    """Refuse early a folder that can't become one.

    Raises
    ------
    InputError
        A file of that name is in the way.
    """
    for level in (folder, *folder.parents):
        if level.exists() and not level.is_dir():
            raise InputError(f"{level}: a file of that name is in the way; give another folder by --out.")


def _unwritable(path: Path, error: OSError) -> InputError:
    reason = os.strerror(error.errno) if error.errno else str(error).splitlines()[0]
    return InputError(f"{path}: cannot be written ({reason}); choose another place or make room there.")
