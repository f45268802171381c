"""Start Mitsuba once for all tests, with few threads; fixtures that many tests share."""

import os
from pathlib import Path

N_THREAD = min(4, os.cpu_count() or 1)
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(variable, str(N_THREAD))  # read when numpy and numba are imported

import numpy as np
import pytest

from evsdr import jit
from evsdr.errors import InputError

REPOSITORY = Path(__file__).resolve().parent.parent


def pytest_configure():
    """Start Mitsuba before any test module imports it."""
    try:
        jit.start()
    except InputError as error:
        raise pytest.UsageError(str(error)) from error
    import drjit as dr

    dr.set_thread_count(N_THREAD)


@pytest.fixture
def rng() -> np.random.Generator:
    """Give a random generator that starts the same in every test."""
    return np.random.default_rng(0)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Give the folder of optional recordings and photographs; skip the test where it is absent."""
    folder = REPOSITORY.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"no folder {folder}")
    return folder
