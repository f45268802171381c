"""LEDs and their spectra as elements of a scene file."""

import numpy as np


def spectrum_xml(wavelength_nm: np.ndarray, value: np.ndarray, **attribute: str) -> str:
    """Write a spectrum as one XML element.

    Parameters
    ----------
    wavelength_nm : (n,) float
        Wavelengths [nm], regularly spaced or not.
    value : (n,) float
        Samples; linear in between, zero outside.
    **attribute : str
        Attributes of the element: `id` or `name`.

    Returns
    -------
    str
        Element without indentation, one child a line.
    """
    step = np.diff(wavelength_nm)
    regular = np.allclose(step, step[0], rtol=1e-6)
    named = "".join(f' {key}="{text}"' for key, text in attribute.items())
    places = (
        f'    <float name="wavelength_min" value="{wavelength_nm[0]:g}"/>\n'
        f'    <float name="wavelength_max" value="{wavelength_nm[-1]:g}"/>\n'
        if regular
        else f'    <string name="wavelengths" value="{_listed(wavelength_nm)}"/>\n'
    )
    return (
        f'<spectrum type="{"regular" if regular else "irregular"}"{named}>\n{places}'
        f'    <string name="values" value="{_listed(value)}"/>\n'
        "</spectrum>"
    )


def far_led(name: str, spectrum: str, direction: np.ndarray) -> str:
    """Write a directional LED; `direction` (3,) points to it, `spectrum` is the id of its irradiance."""
    x, y, z = _numbers(-direction)
    return (
        f'<emitter type="directional" id="{name}">\n'
        f'    <vector name="direction" x="{x}" y="{y}" z="{z}"/>\n'
        f'    <ref name="irradiance" id="{spectrum}"/>\n'
        "</emitter>"
    )


def near_led(name: str, spectrum: str, position: np.ndarray) -> str:
    """Write a point LED; `spectrum` is the id of its intensity."""
    x, y, z = _numbers(position)
    return (
        f'<emitter type="point" id="{name}">\n'
        f'    <point name="position" x="{x}" y="{y}" z="{z}"/>\n'
        f'    <ref name="intensity" id="{spectrum}"/>\n'
        "</emitter>"
    )


def square_led(name: str, spectrum: str, position: np.ndarray, width: float) -> str:
    """Write a square LED that faces the origin; `spectrum` is the id of its radiance."""
    up = "0, 1, 0" if np.hypot(*position[:2]) < 1e-6 * abs(position[2]) else "0, 0, 1"
    return (
        f'<shape type="rectangle" id="{name}">\n'
        '    <transform name="to_world">\n'
        f'        <scale value="{width / 2:g}"/>\n'
        f'        <lookat origin="{", ".join(_numbers(position))}" target="0, 0, 0" up="{up}"/>\n'
        "    </transform>\n"
        '    <emitter type="area">\n'
        f'        <ref name="radiance" id="{spectrum}"/>\n'
        "    </emitter>\n"
        "</shape>"
    )


def _numbers(v: np.ndarray) -> list[str]:
    return [f"{round(c, 6) + 0.0:g}" for c in np.asarray(v, float).tolist()]


def _listed(values: np.ndarray) -> str:
    return " ".join(f"{v:.6g}" for v in values)
