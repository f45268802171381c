"""Find a usable libLLVM and start Mitsuba.

Dr.Jit compiles its kernels with a libLLVM that it loads when it is first imported. With LLVM 15 and 16 the
first kernel with a minimum or maximum aborts the process, which no `try` can catch: hence the version is
checked before any kernel runs. `python -m evsdr.jit` tells which libLLVM is used.
"""

import importlib
import os
import platform
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

from evsdr.errors import InputError, check_address_space, lacking
from evsdr.signals import undisturbed
from evsdr.threads import most_threads

VARIANTS = ("llvm_ad_spectral", "cuda_ad_spectral")
OLDEST = 19
LIBRARIES = 800 << 20  # bytes of address space of Mitsuba, LLVM, numba and SciPy, with 2 threads; measured
PREFERRED = (19, 22, 20, 21)  # 19 and 22 are tried; newer ones come last

# libLLVM.so.19.1, libLLVM-19.so, libLLVM-19.so.1, libLLVM-14.0.6.so.1, libLLVM.dylib, LLVM-C.dll
_NAME = re.compile(r"libLLVM(?:-(\d+)[\d.]*)?\.(?:so|dylib)(?:\.(\d\d+))?[\d.]*|LLVM-C\.dll")

_ASK = """
import ctypes, sys
major = ctypes.c_uint()
ctypes.CDLL(sys.argv[1]).LLVMGetVersion(ctypes.byref(major), None, None)
print(major.value)
"""

_INSTALL = (
    ("apt-get", f"sudo apt-get install libllvm{OLDEST} libatomic1 (a release without it: see apt.llvm.org)"),
    ("dnf", "sudo dnf install llvm-libs libatomic"),
    ("pacman", "sudo pacman -S llvm-libs"),
    ("brew", "brew install llvm"),
    ("winget", "winget install LLVM.LLVM"),
    ("conda", f"conda install -c conda-forge libllvm{OLDEST}"),
)


def start(variant: str | None = None) -> None:
    """Start Mitsuba with a variant and register the plugins of evsdr; once per process is enough.

    Call it before anything imports `drjit` or `mitsuba`: Dr.Jit then loads the libLLVM that is found here,
    by way of the environment variable DRJIT_LIBLLVM_PATH.

    Parameters
    ----------
    variant : str, optional
        One of `VARIANTS`; by default the one that runs, or the first.

    Raises
    ------
    InputError
        If no usable libLLVM or GPU is there, the process already runs another variant, EVSDR_THREADS is no number, or
        the process may take too little address space.
    """
    if variant is None:
        running = sys.modules["mitsuba"].variant() if "mitsuba" in sys.modules else None
        variant = running if running in VARIANTS else VARIANTS[0]
    if variant not in VARIANTS:
        raise InputError(f"evsdr runs as {' or '.join(VARIANTS)}, not as {variant}.")
    needs_llvm = variant.startswith("llvm_")
    if needs_llvm and "drjit" not in sys.modules:
        check_address_space("Mitsuba, with the libraries that it needs,", LIBRARIES)
        library = find_llvm()
        if library is None:
            raise InputError(f"No libLLVM {OLDEST} or newer was found; install one: {install_command()}.")
        os.environ["DRJIT_LIBLLVM_PATH"] = str(library)

    try:
        with undisturbed():  # they abort the process where an import is stopped
            import drjit as dr
            import mitsuba as mi
    except ModuleNotFoundError as error:
        raise InputError(lacking(error.name)) from error
    except (ImportError, NameError) as error:  # a missing system library is a NameError in drjit 1.5
        cause = error.__context__ or error
        remedy = f"install what is missing, such as: {install_command()}"
        raise InputError(f"Mitsuba can't be loaded ({cause}); {remedy}.") from error

    active = mi.variant()
    if active not in (None, variant):
        raise InputError(f"Mitsuba already runs as {active}; use {variant} in a new process.")
    try:
        mi.set_variant(variant)
    except ImportError as error:
        gpu = "use llvm_ad_spectral, or a machine with an NVIDIA GPU and its driver"
        remedy = f"install LLVM: {install_command()}" if needs_llvm else gpu
        raise InputError(f"Mitsuba can't run as {variant} here; {remedy}.") from error
    if needs_llvm and dr.detail.llvm_version() < (OLDEST,):
        loaded = ".".join(map(str, dr.detail.llvm_version()))
        raise InputError(
            f"Dr.Jit has loaded LLVM {loaded} and needs {OLDEST} or newer;"
            " call evsdr.jit.start before importing drjit or mitsuba."
        )
    mi.set_log_level(mi.LogLevel.Warn)
    n_thread = most_threads() or dr.thread_count()
    if n_thread != dr.thread_count():
        dr.set_thread_count(n_thread)
    importlib.import_module("evsdr.integrators.ring")


def threads_for_images() -> AbstractContextManager:
    """Give Mitsuba two threads at least: with one it waits for ever where it reads or writes EXR.

    Else it may have one: others wait busily, on cores that another process may need. Measured (tests/effects, fitting and solve, 2 at a time on 2 cores): 111 s for 160.
    """
    return _threads(lambda n: max(n, 2))


def one_thread() -> AbstractContextManager:
    """Let Dr.Jit work in the thread that calls it: after small work others wait busily, on cores that Numba's kernels need.

    Measured of what pixels share (`scenes/sphere.xml`, 64 x 64, 2 cores): a fit takes 7.4 s for 7.9.
    """
    return _threads(lambda n: 1)


@contextmanager
def _threads(wanted: Callable[[int], int]) -> Iterator[None]:
    """Change how many threads Dr.Jit has, from those before, for a while."""
    import drjit as dr

    before = dr.thread_count()
    dr.set_thread_count(wanted(before))
    try:
        yield
    finally:
        dr.set_thread_count(before)


def find_llvm(root: Path = Path("/")) -> Path | None:
    """Find the libLLVM that Dr.Jit shall load.

    Parameters
    ----------
    root : Path
        Top of the file system.

    Returns
    -------
    Path or None
        The file that DRJIT_LIBLLVM_PATH names; without it the preferred one of those installed.

    Raises
    ------
    InputError
        If DRJIT_LIBLLVM_PATH names something else than a libLLVM of a usable version.
    """
    named = os.environ.get("DRJIT_LIBLLVM_PATH")
    if named:
        version = library_version(Path(named))
        if version is None or version < OLDEST:
            what = "not a loadable libLLVM" if version is None else f"LLVM {version}"
            raise InputError(
                f"DRJIT_LIBLLVM_PATH names {named}, which is {what};"
                f" unset it or name the full path of a libLLVM {OLDEST} or newer."
            )
        return Path(named)

    found = {}  # the first file of each version
    for folder in library_folders(root):
        for file in sorted([*folder.glob("libLLVM[-.]*"), *folder.glob("LLVM-C.dll")]):
            if _NAME.fullmatch(file.name):
                found.setdefault(library_version(file), file)
    usable = [version for version in found if version is not None and version >= OLDEST]
    return found[min(usable, key=_rank)] if usable else None


def library_version(file: Path) -> int | None:
    """Tell the major version of a libLLVM: by its name, links resolved, else by asking it in a child process.

    None for what is no libLLVM, does not load, or is too old to tell (15 and before).
    """
    if not file.is_file():
        return None
    match = _NAME.fullmatch(file.resolve().name)
    if match and (match[1] or match[2]):
        return int(match[1] or match[2])
    ask = [sys.executable, "-c", _ASK, str(file)]
    child = subprocess.run(ask, capture_output=True, text=True, check=False)
    return int(child.stdout) if child.returncode == 0 else None


def library_folders(root: Path = Path("/")) -> list[Path]:
    """List the folders where a libLLVM is looked for, those of the Python environment first."""
    prefix = Path(sys.prefix)
    multiarch = f"usr/lib/{platform.machine()}-linux-gnu"
    if sys.platform == "win32":
        program_files = Path(os.environ.get("ProgramFiles", r"C:\Program Files"))
        path = [Path(folder) for folder in os.environ.get("PATH", "").split(os.pathsep) if folder]
        return [prefix / "Library/bin", *path, program_files / "LLVM/bin"]
    if sys.platform == "darwin":
        patterns = ["opt/homebrew/opt/llvm*/lib", "usr/local/opt/llvm*/lib"]
    else:
        patterns = [multiarch, "usr/lib64", "usr/lib", "usr/lib/llvm-*/lib", "usr/local/lib"]
    system = [folder for pattern in patterns for folder in sorted(root.glob(pattern))]
    return [prefix / "lib", prefix / "llvm" / multiarch, *system]


def install_command() -> str:
    """Give the command that installs a usable libLLVM on this machine."""
    for manager, command in _INSTALL:
        if shutil.which(manager):
            return command
    return f"use the system's package manager, or set DRJIT_LIBLLVM_PATH to a libLLVM {OLDEST} or newer"


def _rank(version: int) -> int:
    return PREFERRED.index(version) if version in PREFERRED else version


def main() -> int:
    """Start Mitsuba and print which libLLVM it uses."""
    try:
        start()
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    print(f"Mitsuba runs with {os.environ['DRJIT_LIBLLVM_PATH']}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
