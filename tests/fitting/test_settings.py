"""Settings that are none are refused in a sentence."""

import pytest

from evsdr.errors import InputError
from evsdr.fitting.settings import PRIORS, SHARED, Settings, check_names, check_settings


def test_good_settings():
    check_settings(Settings())
    check_settings(Settings(shared=(), leds_told_to=2.0))
    check_settings(Settings(shared=("powers", "lag")))
    check_settings(Settings(preset="accurate", shadows="estimate", priors=(), seed=2**32 - 1, limit_deg=1e-3))


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ({"shadows": "dark"}, "shadows is 'dark'; choose one of auto, off, scene"),
        ({"preset": None}, "preset is None; choose one of fast"),
        ({"priors": ("normal", "hope")}, "priors: there is no 'hope'; name some of normal"),
        ({"shared": ("lag", "moods")}, "shared: there is no 'moods'; name some of powers, lag"),
        ({"leds_told_to": -1.0}, "leds_told_to is -1; give degrees"),
        ({"leds_told_to": float("nan")}, "leds_told_to is nan"),
        ({"seed": -1}, "seed is -1"),
        ({"limit_deg": 0.0}, "limit_deg is 0"),
        ({"limit_deg": float("nan")}, "limit_deg is nan"),
    ],
)
def test_bad_settings(setting, words):
    with pytest.raises(InputError, match=words):
        check_settings(Settings(**setting))


@pytest.mark.parametrize(("known", "what"), [(PRIORS, "priors"), (SHARED, "shared")])
def test_names_are_those_that_there_are(known, what):
    check_names(known, known, what)
    with pytest.raises(InputError, match=f"^--{what} x: there is no 'x'; name some of {known[0]}"):
        check_names(("x",), known, f"--{what} x")
