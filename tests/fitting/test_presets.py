"""Presets go from fast to accurate in all that they settle."""

from typing import get_args, get_type_hints

from evsdr.fitting.presets import PRESETS
from evsdr.fitting.settings import Settings


def test_each_choice_has_one():
    assert tuple(PRESETS) == get_args(get_type_hints(Settings)["preset"])


def test_they_grow():
    fast, balanced, accurate = PRESETS.values()
    assert fast.rays < balanced.rays < accurate.rays
    assert (fast.thorough, balanced.thorough, accurate.thorough) == (False, True, True)
