"""Tables of LEDs: what they may say, and one sentence for what they may not."""

import numpy as np
import pytest

from evsdr.errors import InputError
from evsdr.rig.led_table import read_leds


def write(folder, text, name="leds.csv"):
    (folder / name).write_text(text, encoding="utf-8")
    return folder / name


def test_positions_and_angles_tell_the_same(tmp_path):
    place = 100 * np.array([np.sin(0.7), 0, np.cos(0.7)])
    text = "x,y,z,wavelength_nm,power\n" + ",".join(f"{v:.9f}" for v in place) + ",500,2\n0,0,50,500,3\n"
    one, axis = read_leds(write(tmp_path, text))
    text = f"Azimuth_deg;polar_deg;distance;wavelength_nm;power\n\n# first\n0;{np.degrees(0.7)};100;500;2\n0;0;50;500;3\n"
    other, _ = read_leds(write(tmp_path, "\ufeff" + text))
    np.testing.assert_allclose(one.direction, other.direction, atol=1e-9)
    assert one.distance == pytest.approx(100) and other.distance == pytest.approx(100)
    assert (one.power, axis.power) == (2, 3)
    np.testing.assert_array_equal(axis.direction, [0, 0, 1])


def test_far_leds_intensity_and_size(tmp_path):
    far, _ = read_leds(write(tmp_path, "azimuth_deg,polar_deg,wavelength_nm,name\n90,45,500,a\n0,0,600,b\n"))
    assert far.distance is None and far.power == 1 and far.size == 0
    np.testing.assert_allclose(far.direction, [0, np.sqrt(0.5), np.sqrt(0.5)], atol=1e-12)
    near, _ = read_leds(
        write(tmp_path, "x,y,z,wavelength_nm,intensity,size\n0,0,4,500,32,0.5\n0,0,1,500,1,0\n")
    )
    assert near.power == 2 and near.size == 0.5


def test_a_measured_spectrum(tmp_path):
    write(tmp_path, "nm,light\n300,9\n400,0\n450,4\n470,0\n", "blue.csv")
    one, other = read_leds(write(tmp_path, "azimuth_deg,polar_deg,spectrum\n0,45,blue.csv\n90,45,blue.csv\n"))
    np.testing.assert_array_equal(one.wavelength_nm, [300, 400, 450, 470])
    inside = 4 / one.density[2]
    assert inside == pytest.approx(0.5 * 40 * 3.6 + 0.5 * 70 * 4, rel=1e-3)  # from 360 nm on
    assert other.density is one.density


HEAD = "azimuth_deg,polar_deg,wavelength_nm"


@pytest.mark.parametrize(
    "text, sentence",
    [
        ("", "its columns must tell in one way where LEDs stand"),
        (f"{HEAD}\n0,45,500\n", "it has 1 LEDs; write 2 to 256"),
        (f"{HEAD}\n" + 257 * "0,45,500\n", "it has 257 LEDs"),
        (f"{HEAD}\n0,45\n0,45,500\n", "line 2: it has 2 cells, not 3"),
        (f"{HEAD}\n0,45,blue\n0,45,500\n", "line 2: wavelength_nm is 'blue'"),
        (f"{HEAD}\n0,45,500\n0,nan,500\n", "line 3: polar_deg is 'nan'"),
        (f"{HEAD}\n0,45,500\n0,,500\n", "line 3: polar_deg is ''"),
        (f"{HEAD}\n0,45,5e-7\n0,45,500\n", "wavelength_nm is 5e-07; light from 360 to 830 nm"),
        (f"{HEAD}\n0,90,500\n0,45,500\n", "line 2: the LED does not stand before the object"),
        (f"{HEAD},power\n0,45,500,0\n0,45,500,1\n", "line 2: power is 0; it must be 1e-09 or more"),
        (f"{HEAD},width_nm\n0,45,500,-3\n0,45,500,1\n", "line 2: an LED is -3 nm wide"),
        (f"{HEAD},width_below_nm\n0,45,500,3\n0,45,500,3\n", "width_below_nm and width_above_nm go together"),
        (f"{HEAD},distance\n0,45,500,0\n0,45,500,1\n", "line 2: distance is 0"),
        (f"{HEAD},intensity\n0,45,500,1\n0,45,500,1\n", "line 2: a far LED has no intensity"),
        (f"{HEAD},size\n0,45,500,1\n0,45,500,1\n", "line 2: size is 1; only a near LED has one"),
        (f"{HEAD},colour\n0,45,500,1\n", "the column 'colour' is not known"),
        (f"{HEAD},power,power\n0,45,500,1,1\n", "the column 'power' comes twice"),
        (f"{HEAD},power,intensity\n0,45,500,1,1\n", "power and intensity tell the same"),
        (f"{HEAD},x\n0,45,500,1\n", "in one way where LEDs stand"),
        (f"{HEAD},spectrum\n0,45,500,a.csv\n", "in one way what light they give"),
        ("x,y,z,wavelength_nm\n0,0,0,500\n0,0,1,500\n", "line 2: the distance from the origin is 0"),
        ("x,y,z,spectrum\n0,0,1,none.csv\n0,0,1,none.csv\n", "none.csv: this is no spectrum"),
        ("x,y,z,spectrum\n0,0,1,\n0,0,1,a\n", "line 2: spectrum is empty"),
        ("x,y,z,spectrum\n0,0,1,back.csv\n0,0,1,back.csv\n", "back.csv: its wavelengths must grow"),
        ("x,y,z,spectrum\n0,0,1,um.csv\n0,0,1,um.csv\n", "um.csv: it has no light from 360 to 830 nm"),
        (f'{HEAD}\n0,"45,500\n', "not a readable table of LEDs"),
        ("\0" * 50, "not a readable table|is not known"),
    ],
)
def test_hostile_tables(tmp_path, text, sentence):
    write(tmp_path, "500,1\n490,1\n", "back.csv")
    write(tmp_path, "0.4,1\n0.5,1\n", "um.csv")
    with pytest.raises(InputError, match=sentence) as refused:
        read_leds(write(tmp_path, text))
    assert "\n" not in str(refused.value)


def test_what_is_no_file(tmp_path):
    with pytest.raises(InputError, match="not a readable table"):
        read_leds(tmp_path)
    (tmp_path / "leds.csv").write_bytes(b"\xff\xfe\x00x")
    with pytest.raises(InputError, match="not a readable table"):
        read_leds(tmp_path / "leds.csv")
