"""The drawing of a ring: what it says in millimetres is where the LEDs are."""

import xml.etree.ElementTree as xml

import numpy as np
import pytest

from evsdr.limits.drawing import HOLE_MM, positions_mm, ring_drawing

LEDS = [
    {"id": f"led_{j:02d}", "centroid_nm": nm, "azimuth_deg": 90.0 * j, "polar_deg": polar}
    for j, (nm, polar) in enumerate([(405, 30), (460, 45), (525, 45), (635, 30)])
]
SVG = "{http://www.w3.org/2000/svg}"


def test_leds_lie_on_a_sphere_in_the_told_directions():
    at = positions_mm(LEDS, 200.0)
    assert np.linalg.norm(at, axis=1) == pytest.approx(np.full(4, 200.0))
    assert at[0] == pytest.approx([100.0, 0, 200 * np.cos(np.pi / 6)])  # 30 deg: sine one half
    assert at[1] == pytest.approx([0, 100 * 2**0.5, 100 * 2**0.5])


def test_the_face_is_drawn_to_scale_and_y_goes_up():
    picture = xml.fromstring(ring_drawing(LEDS, 200.0))
    assert picture.get("width") == f"{picture.get('viewBox').split(' ')[2]}mm"  # a unit is a millimetre
    face = picture.findall(f"{SVG}g")[0]
    holes = [circle for circle in face.iter(f"{SVG}circle") if circle.get("fill") != "none"]
    assert {hole.get("r") for hole in holes} == {f"{HOLE_MM / 2:.2f}"}
    drawn = np.array([[float(hole.get("cx")), -float(hole.get("cy"))] for hole in holes])
    assert drawn == pytest.approx(positions_mm(LEDS, 200.0)[:, :2], abs=0.006)
    assert len({hole.get("fill") for hole in holes}) == 4


def test_the_table_names_chip_and_output():
    words = [text.text for text in xml.fromstring(ring_drawing(LEDS, 200.0)).iter(f"{SVG}text")]
    assert {"U1, OUT0", "U3, OUT0", "U1, OUT1", "U3, OUT1"} <= set(words) and "-0.0" not in words
    assert any("173.2 mm above the object; LEDs tilted 30.0 deg" in word for word in words)
