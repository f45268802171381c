"""Which libLLVM is found, and what is said when Mitsuba can't start."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from evsdr import jit
from evsdr.errors import InputError

MULTIARCH = Path("usr/lib/x86_64-linux-gnu")


@pytest.fixture
def linux(tmp_path, monkeypatch):
    """Give the root of an empty Linux file system, and the function that lays libraries there."""
    monkeypatch.delenv("DRJIT_LIBLLVM_PATH", raising=False)
    monkeypatch.setattr(jit.platform, "machine", lambda: "x86_64")
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(sys, "prefix", str(tmp_path / "venv"))

    def lay(*names, folder=MULTIARCH):
        (tmp_path / folder).mkdir(parents=True, exist_ok=True)
        for name in names:
            (tmp_path / folder / name).touch()
        return tmp_path / folder

    return tmp_path, lay


def test_no_library_gives_none(linux):
    root, _ = linux
    assert jit.find_llvm(root) is None


@pytest.mark.parametrize(
    "names",
    [
        ["libLLVM-14.so.1", "libLLVM-14.0.6.so.1"],
        ["libLLVM-15.so", "libLLVM-15.so.1", "libLLVM-16.so.1"],
        ["libLLVM.so.18.1", "libLLVM-17.so"],
        ["libLLVM.so"],  # empty: does not load
    ],
)
def test_unusable_libraries_are_never_picked(linux, names):
    root, lay = linux
    lay(*names)
    assert jit.find_llvm(root) is None


def test_files_that_only_begin_like_it_are_passed_over(linux, monkeypatch):
    root, lay = linux
    lay("libLLVMSPIRVLib.so.19.1", "libLLVM-19-private.so", "libLLVM.so.19.1-gdb.py")
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: pytest.fail("a file was loaded"))
    assert jit.find_llvm(root) is None


@pytest.mark.parametrize(
    ("names", "picked"),
    [
        (["libLLVM-15.so.1", "libLLVM.so.19.1"], "libLLVM.so.19.1"),
        (["libLLVM-19.so.1"], "libLLVM-19.so.1"),
        (["libLLVM.so.19.1", "libLLVM.so.22.1"], "libLLVM.so.19.1"),
        (["libLLVM.so.20.1", "libLLVM.so.21.1", "libLLVM.so.22.1"], "libLLVM.so.22.1"),
        (["libLLVM.so.20.1", "libLLVM.so.21.1"], "libLLVM.so.20.1"),
        (["libLLVM.so.21.1", "libLLVM.so.23.1"], "libLLVM.so.21.1"),
        (["libLLVM.so.24.1", "libLLVM.so.23.1"], "libLLVM.so.23.1"),
    ],
)
def test_preferred_version_is_picked(linux, names, picked):
    root, lay = linux
    folder = lay(*names)
    assert jit.find_llvm(root) == folder / picked


@pytest.mark.parametrize(
    "folder", [MULTIARCH, "usr/lib64", "usr/lib/llvm-20/lib", "usr/local/lib", "venv/lib"]
)
def test_folders_on_linux(linux, folder):
    root, lay = linux
    assert jit.find_llvm(root) is None
    lay("libLLVM.so.20.1", folder=folder)
    assert jit.find_llvm(root) == root / folder / "libLLVM.so.20.1"


def test_library_of_the_environment_wins_over_that_of_the_system(linux):
    root, lay = linux
    lay("libLLVM.so.19.1")
    folder = lay("libLLVM.so.19.1", folder="venv/llvm" / MULTIARCH)
    assert jit.find_llvm(root) == folder / "libLLVM.so.19.1"


def test_library_of_another_architecture_is_not_picked(linux):
    root, lay = linux
    lay("libLLVM.so.19.1", folder="usr/lib/aarch64-linux-gnu")
    assert jit.find_llvm(root) is None


def test_folders_on_macos(linux, monkeypatch):
    root, lay = linux
    monkeypatch.setattr(sys, "platform", "darwin")
    folder = lay("libLLVM-20.dylib", folder="opt/homebrew/opt/llvm@20/lib")
    assert jit.find_llvm(root) == folder / "libLLVM-20.dylib"


def test_folders_on_windows(linux, monkeypatch):
    root, lay = linux
    folder = lay("LLVM-C.dll", folder="bin")
    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setenv("PATH", str(folder))
    monkeypatch.setattr(jit, "library_version", lambda file: 19)
    assert jit.find_llvm(root) == folder / "LLVM-C.dll"


def test_a_link_counts_as_what_it_points_to(linux):
    root, lay = linux
    folder = lay("libLLVM-15.so.1", "libLLVM.so.22.1")
    (folder / "libLLVM-19.so").symlink_to("libLLVM-15.so.1")
    assert jit.library_version(folder / "libLLVM-19.so") == 15
    assert jit.find_llvm(root) == folder / "libLLVM.so.22.1"


def test_version_that_the_name_does_not_tell_is_asked(tmp_path, monkeypatch):
    monkeypatch.setattr(jit, "_NAME", re.compile("libLLVM"))
    assert jit.library_version(jit.find_llvm()) == dr.detail.llvm_version()[0]
    (tmp_path / "libLLVM.so").touch()
    assert jit.library_version(tmp_path / "libLLVM.so") is None


def test_environment_variable_wins(linux, monkeypatch):
    root, lay = linux
    lay("libLLVM.so.19.1")
    named = lay("libLLVM.so.22.1", folder="own") / "libLLVM.so.22.1"
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", str(named))
    assert jit.find_llvm(root) == named


@pytest.mark.parametrize(
    ("name", "what"), [("libLLVM-16.so.1", "LLVM 16"), ("libLLVM.so", "not a loadable libLLVM")]
)
def test_environment_variable_that_names_no_usable_library(linux, monkeypatch, name, what):
    root, lay = linux
    folder = lay("libLLVM.so.19.1", name)
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", str(folder / name))
    with pytest.raises(InputError, match=rf"^DRJIT_LIBLLVM_PATH names \S+{name}, which is {what}; unset"):
        jit.find_llvm(root)


def test_environment_variable_that_names_nothing(linux, monkeypatch):
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", "/nowhere/libLLVM.so.19.1")
    with pytest.raises(InputError, match="not a loadable libLLVM"):
        jit.find_llvm(linux[0])


@pytest.mark.parametrize(
    ("manager", "command"),
    [
        ("apt-get", "sudo apt-get install libllvm19"),
        ("dnf", "sudo dnf install llvm-libs"),
        ("brew", "brew install llvm"),
        (None, "DRJIT_LIBLLVM_PATH"),
    ],
)
def test_no_library_names_the_command(monkeypatch, manager, command):
    monkeypatch.setattr(jit, "find_llvm", lambda: None)
    monkeypatch.setattr(shutil, "which", lambda name: name if name == manager else None)
    monkeypatch.delitem(sys.modules, "drjit")
    with pytest.raises(InputError, match=f"^No libLLVM 19 or newer was found; install one: .*{command}"):
        jit.start()


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (
            ImportError("libatomic.so.1: cannot open shared object file"),
            r"Mitsuba can't be loaded \(libatomic\.so\.1: .*\); install",
        ),
        (
            ModuleNotFoundError("No module named 'mitsuba'", name="mitsuba"),
            ".* has no package mitsuba; type ",
        ),
    ],
)
def test_what_is_missing_is_named(monkeypatch, error, said):
    class Absent:
        def find_spec(self, name, path=None, target=None):
            if name == "mitsuba":
                raise error

    monkeypatch.delitem(sys.modules, "mitsuba")
    monkeypatch.setattr(sys, "meta_path", [Absent(), *sys.meta_path])
    with pytest.raises(InputError, match=f"^{said}"):
        jit.start()


def test_old_llvm_is_refused_before_any_kernel(monkeypatch):
    monkeypatch.setattr(dr.detail, "llvm_version", lambda: (16, 0, 6))
    with pytest.raises(InputError, match=r"^Dr\.Jit has loaded LLVM 16\.0\.6 and needs 19"):
        jit.start()


def test_one_variant_per_process():
    jit.start()
    with pytest.raises(InputError, match="runs as llvm_ad_spectral; use cuda_ad_spectral in a new process"):
        jit.start("cuda_ad_spectral")


def test_what_runs_is_kept(monkeypatch):
    monkeypatch.setattr(mi, "variant", lambda: "cuda_ad_spectral")
    chosen = []
    monkeypatch.setattr(mi, "set_variant", chosen.append)
    jit.start()
    assert chosen == ["cuda_ad_spectral"]


@pytest.mark.parametrize("asked", [1, 3])
def test_threads_are_as_asked_but_for_images(monkeypatch, tmp_path, asked):
    """With one, Mitsuba would wait for ever here."""
    import drjit as dr
    import mitsuba as mi

    before = dr.thread_count()
    monkeypatch.setenv("EVSDR_THREADS", str(asked))
    try:
        jit.start()
        assert dr.thread_count() == asked
        with jit.threads_for_images():
            assert dr.thread_count() == max(asked, 2)
            mi.Bitmap(np.ones((40, 40, 3), np.float32)).write(str(tmp_path / "image.exr"))
        assert dr.thread_count() == asked
        with jit.one_thread():
            assert dr.thread_count() == 1
        assert dr.thread_count() == asked
    finally:
        dr.set_thread_count(before)


def test_unknown_variant():
    with pytest.raises(InputError, match="not as scalar_rgb"):
        jit.start("scalar_rgb")


def test_no_gpu(monkeypatch):
    def refuse(variant):
        raise ImportError("the CUDA backend hasn't been initialized")

    monkeypatch.setattr(mi, "variant", lambda: None)
    monkeypatch.setattr(mi, "set_variant", refuse)
    with pytest.raises(InputError, match="can't run as cuda_ad_spectral here; use llvm_ad_spectral"):
        jit.start("cuda_ad_spectral")


def test_command_tells_the_library(monkeypatch):
    library = str(jit.find_llvm())
    command = [sys.executable, "-m", "evsdr.jit"]
    run = subprocess.run(command, capture_output=True, text=True, check=True)
    assert library in run.stdout
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", "/nowhere/libLLVM.so.19.1")
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode == 2
    assert run.stdout == ""
    assert run.stderr.startswith("DRJIT_LIBLLVM_PATH names /nowhere")
    assert run.stderr.count("\n") == 1
