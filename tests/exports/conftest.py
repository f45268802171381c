"""Results of a fit, without one: those of a sphere."""

import pytest

from tests.support.page_fits import make_fit
from tests.support.saved_fits import save


@pytest.fixture(scope="session")
def fit():
    return make_fit(3, 20, 26)


@pytest.fixture(scope="session")
def results(fit, tmp_path_factory):
    return save(tmp_path_factory.mktemp("fit"), fit)
