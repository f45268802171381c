"""Kernels of numba that were compiled from sources that have changed since.

Numba keeps what it compiled beside each module and looks whether that module has changed, but not those whose functions and
numbers are compiled into it: after `git pull` a kernel would go on with the old ones, without a word.
"""

import re
import time
from contextlib import suppress
from pathlib import Path

IMPORT = re.compile(r"^from (\w+(?:\.\w+)*) import", re.MULTILINE)


def forget_stale(package: Path) -> list[Path]:
    """Remove kernels that are older than a source that they, or others of the package, are made of.

    Parameters
    ----------
    package : Path
        Its folder. Sources are modules that have kernels, and those of the package that these import from.

    Returns
    -------
    list of Path
        The indices (.nbi) that were removed, with their kernels.
    """
    kept = list(package.rglob("__pycache__/*.nbi"))
    modules = {index.parent.parent / f"{index.name.partition('.')[0]}.py" for index in kept}
    sources = {
        source for module in modules if module.exists() for source in (module, *_imports(module, package))
    }
    now = time.time()  # by a clock that went wrong, sources of tomorrow would take kernels at every import
    newest = max((t for t in (source.stat().st_mtime for source in sources) if t <= now), default=0.0)
    stale = [index for index in kept if _age(index) < newest]
    for index in stale:
        for file in (index, *index.parent.glob(f"{index.stem}.*.nbc")):
            with suppress(OSError):  # another process was quicker, or they are not ours to remove
                file.unlink()
    return stale


def _age(index: Path) -> float:
    """Give when an index was written [s]; one that another process has just removed is not stale."""
    try:
        return index.stat().st_mtime
    except FileNotFoundError:
        return float("inf")


def _imports(module: Path, package: Path) -> list[Path]:
    """Give the modules of the package that a module imports from by their whole names."""
    names = IMPORT.findall(module.read_text(encoding="utf-8"))
    files = (package.parent / f"{name.replace('.', '/')}.py" for name in names)
    return [file for file in files if file.is_relative_to(package) and file.exists()]
