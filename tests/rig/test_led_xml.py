"""LEDs as elements of a scene file."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest

from evsdr.rig.led_xml import far_led, near_led, spectrum_xml, square_led


def test_spectra_are_regular_or_not():
    even = ET.fromstring(spectrum_xml(np.array([400.0, 405, 410]), np.array([0, 0.5, 0]), id="a"))
    assert {e.get("name"): e.get("value") for e in even} == {
        "wavelength_min": "400",
        "wavelength_max": "410",
        "values": "0 0.5 0",
    }
    uneven = ET.fromstring(spectrum_xml(np.array([400.0, 401, 410]), np.array([0, 0.5, 0]), name="b"))
    assert uneven.get("type") == "irregular" and uneven.get("name") == "b"
    assert uneven.find("string[@name='wavelengths']").get("value") == "400 401 410"


def test_directions_point_away_from_the_led():
    vector = ET.fromstring(far_led("led_00", "band", np.array([0.6, 0.0, 0.8]))).find("vector")
    assert [float(vector.get(axis)) for axis in "xyz"] == [-0.6, 0, -0.8]
    point = ET.fromstring(near_led("led_00", "band", np.array([1.0, 2.0, 3.0]))).find("point")
    assert [point.get(axis) for axis in "xyz"] == ["1", "2", "3"]


@pytest.mark.parametrize("position, up", [([0, 0, 3], "0, 1, 0"), ([1, 0, 3], "0, 0, 1")])
def test_a_square_faces_the_origin(position, up):
    lookat = ET.fromstring(square_led("led_00", "band", np.array(position), 0.4)).find(".//lookat")
    assert lookat.get("target") == "0, 0, 0" and lookat.get("up") == up
