"""Extremes that once went wrong."""

import pytest

from experiments.extremes.__main__ import HEAD, line
from experiments.extremes.cases import Case, cases
from experiments.extremes.compute import Result, measure
from experiments.extremes.scenes import Scene


@pytest.mark.slow
def test_what_pixels_share_stays_as_told_where_darkness_is_dark():
    """A photoreceptor without a lag has none in the light of a thousandth either: 18 degrees, once."""
    result = measure(Case("", "", Scene(width=8, height=8, constant_light=1e-3, tilt_deg=20.0)))
    assert result.known == 1 and result.mae_deg < 1.0 and result.within > 0.95
    assert result.reflectance < 0.05 and "so weak" in result.said


def test_a_steep_plane_turns_no_powers():
    """What is held to be likely of one pixel pulls all of a plane alike: counted as often as pixels, 15 to 36 degrees."""
    result = measure(Case("", "", Scene(width=12, height=12, tilt_deg=80.0)))
    assert result.known == 1 and result.mae_deg < 0.5 and result.within > 0.95
    assert result.reflectance < 0.03 and result.state == "trustworthy"


def test_what_cant_be_recorded_is_a_line_of_the_table():
    result = measure(Case("C_w", "100", Scene(width=4, height=4, constant_light=100.0), rounds=1))
    assert result.state == "refused" and result.said.endswith(".")
    assert line(result).count("|") == HEAD.count("|") == line(Result("a", "b", "NaN")).count("|")


def test_cases_have_names_of_their_own():
    names = [(case.group, case.value) for case in cases(large=True)]
    assert len(set(names)) == len(names) > 60
