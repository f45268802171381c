"""Start Mitsuba once for all tests, with few threads; fixtures that many tests share."""

import gc
import os
import shutil
from pathlib import Path

N_WORKER = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", 1))
N_THREAD = max(1, min(4, (os.cpu_count() or 1) // N_WORKER))
for variable in ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(variable, str(N_THREAD))  # read when numpy and numba are imported

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as in a fit, see `evsdr.threads.small_matrices`

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

pytest.register_assert_rewrite("tests.support")

from evsdr import jit
from evsdr.commands import simulate
from evsdr.errors import InputError
from tests.support.chromium import start_chromium
from tests.support.command_line import Commands
from tests.support.small_scene import scene

REPOSITORY = Path(__file__).resolve().parent.parent

# The same few examples every time, however slow the machine.
settings.register_profile(
    "few",
    derandomize=True,
    deadline=None,
    database=None,
    max_examples=15,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)
settings.load_profile("few")


def pytest_configure(config):
    """Start Mitsuba before any test module imports it; a process that only hands tests to others needs none."""
    if config.getoption("numprocesses", None):
        return
    try:
        jit.start()
    except InputError as error:
        raise pytest.UsageError(str(error)) from error
    import drjit as dr

    dr.set_thread_count(N_THREAD)
    gc.freeze()  # what is imported stays, and need not be looked through


@pytest.fixture(autouse=True, scope="module")
def _freed():
    """Free the scenes of a file: Mitsuba compiles kernels for all emitters and materials that live, whoever's they are."""
    yield
    gc.collect()


@pytest.fixture
def rng() -> np.random.Generator:
    """Give a random generator that starts the same in every test."""
    return np.random.default_rng(0)


@pytest.fixture(scope="module")
def browser():
    """Give a browser; skip the tests where there is none."""
    chromium = start_chromium()
    yield chromium
    chromium.close()


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Give the folder of optional recordings and photographs; skip the test where it is absent."""
    folder = REPOSITORY.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"no folder {folder}")
    return folder


@pytest.fixture(scope="session")
def recorded(tmp_path_factory):
    """Give a folder with scene.xml, and events.h5 and truth.npz simulated from it."""
    folder = tmp_path_factory.mktemp("recorded")
    (folder / "scene.xml").write_text(scene())
    assert simulate.main([str(folder / "scene.xml"), "--out", str(folder), "--ideal", "--rounds", "4"]) == 0
    return folder


@pytest.fixture
def place(recorded, tmp_path):
    """Give a copy of that folder, to spoil, with the results of an earlier run in `out`."""
    for name in ("scene.xml", "events.h5", "truth.npz"):
        shutil.copy(recorded / name, tmp_path)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "maps.npz").write_text("an earlier run")
    return tmp_path


@pytest.fixture
def commands(place, capsys):
    return Commands(place, capsys)
