"""Write the rigs of 24 LEDs: far (ring24.xml), near (ring24_near.xml) and finite (ring24_soft.xml)."""

from pathlib import Path
from textwrap import indent

import numpy as np
from evsdr.scenes.formats import HERE, spectrum_xml

N_LED = 24
N_BAND = 8
POLAR_DEG = 45.0
NEAR_DISTANCE = 3.5  # of near LEDs from the origin, in object radii
SOFT_WIDTH = 0.4  # of the square LEDs

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
STEP_NM = 5


def led_spectrum(peak_nm: float, left_nm: float, right_nm: float) -> tuple[np.ndarray, np.ndarray]:
    """Model the spectral irradiance of an LED with a skewed peak.

    (g + 2 g^5) / 3 with g = exp(-((lambda - peak) / width)^2), Ohno 2005, "Spectral design considerations
    for white LED color rendering", here with a width for either side.

    Parameters
    ----------
    peak_nm : float
        Wavelength of the peak [nm].
    left_nm, right_nm : float
        Half widths at half maximum below and above the peak [nm].

    Returns
    -------
    wavelength_nm, irradiance : (n,) float
        Wavelengths [nm] in steps of 5 nm, and irradiance [W/m^2/nm] that integrates to 1 W/m^2.
    """
    width_per_half = 2.17  # (g + 2 g^5) / 3 is one half at width / 2.17
    wavelength = np.arange(360.0, 831.0, STEP_NM)
    shift = wavelength - peak_nm
    g = np.exp(-((shift / (width_per_half * np.where(shift < 0, left_nm, right_nm))) ** 2))
    density = (g + 2 * g**5) / 3
    used = np.flatnonzero(density > 1e-3)
    used = np.arange(max(used[0] - 1, 0), used[-1] + 2)
    density = np.where(density > 1e-3, density, 0.0)[used]
    return wavelength[used], density / np.trapezoid(density, wavelength[used])


def light_directions() -> np.ndarray:
    """Give the unit vectors from the origin to the LEDs, (n_led, 3): LED j has azimuth 15 j degrees."""
    azimuth = 2 * np.pi * np.arange(N_LED) / N_LED
    polar = np.full(N_LED, np.deg2rad(POLAR_DEG))
    return np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=1)


def square_form_factor(width: float, distance: float) -> float:
    """Form factor from a small patch to a square that it faces: irradiance is pi times it times radiance.

    Four corner rectangles, each as in Howell, "A catalog of radiation heat transfer configuration factors",
    B-3.
    """
    x = 0.5 * width / distance
    root = np.sqrt(1 + x * x)
    return 4 * x / root * np.arctan(x / root) / np.pi


def _numbers(v: np.ndarray) -> list[str]:
    return [f"{round(c, 6) + 0.0:g}" for c in v.tolist()]


def _far_led(name: str, band: str, direction: np.ndarray) -> str:
    x, y, z = _numbers(-direction)
    return (
        f'<emitter type="directional" id="{name}">\n'
        f'    <vector name="direction" x="{x}" y="{y}" z="{z}"/>\n'
        f'    <ref name="irradiance" id="{band}"/>\n'
        "</emitter>"
    )


def _near_led(name: str, band: str, direction: np.ndarray) -> str:
    x, y, z = _numbers(NEAR_DISTANCE * direction)
    return (
        f'<emitter type="point" id="{name}">\n'
        f'    <point name="position" x="{x}" y="{y}" z="{z}"/>\n'
        f'    <ref name="intensity" id="{band}"/>\n'
        "</emitter>"
    )


def _soft_led(name: str, band: str, direction: np.ndarray) -> str:
    origin = ", ".join(_numbers(NEAR_DISTANCE * direction))
    return (
        f'<shape type="rectangle" id="{name}">\n'
        '    <transform name="to_world">\n'
        f'        <scale value="{SOFT_WIDTH / 2:g}"/>\n'
        f'        <lookat origin="{origin}" target="0, 0, 0" up="0, 0, 1"/>\n'
        "    </transform>\n"
        '    <emitter type="area">\n'
        f'        <ref name="radiance" id="{band}"/>\n'
        "    </emitter>\n"
        "</shape>"
    )


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


def write(folder: Path = HERE) -> None:
    """Write the three rigs."""
    title = (
        "24 {} at polar angle 45 deg, LED j at azimuth 15 j deg and of band j mod 8.\n"
        "     {} has 1 W/m^2 of each."
    )
    patch = "A patch at the origin that faces it"
    radiance = 1 / (np.pi * square_form_factor(SOFT_WIDTH, NEAR_DISTANCE))
    rigs = {
        "ring24.xml": rig_xml(title.format("far LEDs", "A patch that faces it"), 1.0, _far_led),
        "ring24_near.xml": rig_xml(title.format("near LEDs", patch), NEAR_DISTANCE**2, _near_led),
        "ring24_soft.xml": rig_xml(title.format("square LEDs", patch), radiance, _soft_led),
    }
    for name, text in rigs.items():
        (folder / name).write_text(text)


if __name__ == "__main__":
    write()
