"""Write the rigs of 24 LEDs, far (ring24.xml), near (ring24_near.xml) and finite (ring24_soft.xml), and tables of LEDs."""

from pathlib import Path
from textwrap import indent

import numpy as np
from evsdr.scenes.formats import HERE

from evsdr.rig.led_light import led_spectrum, square_form_factor
from evsdr.rig.led_xml import far_led, near_led, spectrum_xml, square_led

N_LED = 24
N_BAND = 8
POLAR_DEG = 45.0
NEAR_DISTANCE = 3.5  # of near LEDs from the origin, in object radii
SOFT_WIDTH = 0.4  # of the square LEDs
EVENTPS_RADIUS, EVENTPS_HEIGHT, EVENTPS_STEPS = 140.0, 80.0, 48  # [mm]

# Peak and the two half widths at half maximum [nm]. Blue and green LEDs fall off slowly toward the red,
# orange and red ones toward the blue.
BANDS = (
    (405, 7, 8),
    (430, 8, 9),
    (460, 10, 11),
    (490, 12, 15),
    (525, 14, 19),
    (560, 16, 19),
    (595, 9, 7),
    (635, 10, 8),
)


def light_directions() -> np.ndarray:
    """Give the unit vectors from the origin to the LEDs, (n_led, 3): LED j has azimuth 15 j degrees."""
    azimuth = 2 * np.pi * np.arange(N_LED) / N_LED
    polar = np.full(N_LED, np.deg2rad(POLAR_DEG))
    return np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=1)


def _near(name: str, band: str, direction: np.ndarray) -> str:
    return near_led(name, band, NEAR_DISTANCE * direction)


def _soft(name: str, band: str, direction: np.ndarray) -> str:
    return square_led(name, band, NEAR_DISTANCE * direction, SOFT_WIDTH)


def rig_xml(title: str, scale: float, led) -> str:
    """Write a rig: the spectra of its bands, then its LEDs.

    Parameters
    ----------
    title : str
        What the file says of itself.
    scale : float
        Factor on the bands' spectra of unit irradiance: squared distance for an intensity, and so on.
    led : callable (name, band, direction) -> str
        Writes one LED.

    Returns
    -------
    str
        Text of the file.
    """
    part = [f"<!-- {title} Written by make_rigs.py. -->"]
    for b, peak_and_widths in enumerate(BANDS):
        wavelength_nm, irradiance = led_spectrum(*peak_and_widths)
        part.append(spectrum_xml(wavelength_nm, scale * irradiance, id=f"band_{b}"))
    for j, direction in enumerate(light_directions()):
        part.append(led(f"led_{j:02d}", f"band_{j % N_BAND}", direction))
    return '<scene version="3.0.0">\n' + indent("\n\n".join(part), "    ") + "\n</scene>\n"


def ring24_csv() -> str:
    """Write the far LEDs as a table for `python -m evsdr.new_scene`."""
    lines = [
        "# The LEDs of ring24.xml. Written by make_rigs.py.",
        "azimuth_deg,polar_deg,wavelength_nm,width_below_nm,width_above_nm",
    ]
    for j in range(N_LED):
        peak, below, above = BANDS[j % N_BAND]
        lines.append(f"{360 * j / N_LED:g},{POLAR_DEG:g},{peak},{below},{above}")
    return "\n".join(lines) + "\n"


def eventps_csv() -> str:
    """Write the white LED of EventPS (Yu et al., CVPR 2024) that goes round the object as many that stand."""
    lines = [
        "# A white LED that goes round the object, as in EventPS: 14 cm from the axis of the camera, 8 cm above, [mm].",
        "# Check both, and where the LED is at the trigger. Written by make_rigs.py.",
        "x,y,z,wavelength_nm,width_nm",
    ]
    for angle in 2 * np.pi * np.arange(EVENTPS_STEPS) / EVENTPS_STEPS:
        x, y = EVENTPS_RADIUS * np.cos(angle), EVENTPS_RADIUS * np.sin(angle)
        lines.append(f"{round(x, 3) + 0.0:g},{round(y, 3) + 0.0:g},{EVENTPS_HEIGHT:g},560,120")
    return "\n".join(lines) + "\n"


def write(folder: Path = HERE) -> None:
    """Write the three rigs, and two as tables."""
    title = (
        "24 {} at polar angle 45 deg, LED j at azimuth 15 j deg and of band j mod 8.\n"
        "     {} has 1 W/m^2 of each."
    )
    patch = "A patch at the origin that faces it"
    radiance = 1 / (np.pi * square_form_factor(SOFT_WIDTH, NEAR_DISTANCE))
    rigs = {
        "ring24.xml": rig_xml(title.format("far LEDs", "A patch that faces it"), 1.0, far_led),
        "ring24_near.xml": rig_xml(title.format("near LEDs", patch), NEAR_DISTANCE**2, _near),
        "ring24_soft.xml": rig_xml(title.format("square LEDs", patch), radiance, _soft),
    }
    rigs |= {"ring24.csv": ring24_csv(), "eventps.csv": eventps_csv()}
    for name, text in rigs.items():
        (folder / name).write_text(text)


if __name__ == "__main__":
    write()
