"""The page of a small fit, and a browser that shows it."""

import pytest

from tests.support.chromium import open_page
from tests.support.page_fits import make_fit


@pytest.fixture(scope="module")
def fit():
    return make_fit()


@pytest.fixture
def opened(browser, fit, tmp_path):
    """Give the browser with the page of the small fit; nothing may be said on the console."""
    return open_page(browser, tmp_path / "page.html", fit.page())
