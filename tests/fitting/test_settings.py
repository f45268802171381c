"""Settings that are none are refused in a sentence."""

import pytest

from evsdr.errors import InputError
from evsdr.fitting.settings import PRIORS, Settings, check_priors, check_settings


def test_good_settings():
    check_settings(Settings())
    check_settings(Settings(preset="accurate", shadows="estimate", priors=(), seed=2**32 - 1, limit_deg=1e-3))


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ({"shadows": "dark"}, "shadows is 'dark'; choose one of auto, off, scene"),
        ({"preset": None}, "preset is None; choose one of fast"),
        ({"priors": ("normal", "hope")}, "priors: there is no 'hope'; name some of normal"),
        ({"seed": -1}, "seed is -1"),
        ({"limit_deg": 0.0}, "limit_deg is 0"),
        ({"limit_deg": float("nan")}, "limit_deg is nan"),
    ],
)
def test_bad_settings(setting, words):
    with pytest.raises(InputError, match=words):
        check_settings(Settings(**setting))


def test_priors_are_those_that_there_are():
    check_priors(PRIORS, "priors")
    with pytest.raises(InputError, match="^--priors x: there is no 'x'"):
        check_priors(("x",), "--priors x")
