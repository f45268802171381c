"""Read a table of LEDs: where each stands, what light it gives, how strong it is.

A CSV with a line of names, then a line per LED in schedule order. Columns:

`x`, `y`, `z`
    Position [scene units], x right, y up, z toward the camera, from the scene's origin; the LED is near.
`azimuth_deg`, `polar_deg`, perhaps `distance`
    Instead: angle around the camera's axis from right over up, angle from that axis, and distance from the origin [scene
    units]; without it the LED is far.
`wavelength_nm`, perhaps `width_nm`, or `width_below_nm` and `width_above_nm`
    Peak, and full width at half maximum, 20 if left out, or the half widths on either side.
`spectrum`
    Instead: a CSV of wavelength [nm] and light, beside the table.
`power`
    What a white patch at the origin that faces the LED gets; 1 if left out. Any unit, the same for all.
`intensity`
    Instead, of near LEDs: the same at distance 1.
`size`
    Width of a square near LED that faces the origin; if left out it is a point.
"""

import csv
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from evsdr.errors import InputError
from evsdr.files.kind import regular
from evsdr.files.numbers import read_numbers
from evsdr.model.quadrature import WAVELENGTH_NM, integrate
from evsdr.rig.led_light import RANGE_NM, led_spectrum

LARGEST = 4 << 20  # bytes of a table
MOST_LED = 256
MOST = 1e9  # that any number is; lengths and powers are above the inverse of it
SMALLEST = 1e-4  # size of a square LED over its distance; a smaller one is a point
WIDTH_NM = 20.0  # guessed: LEDs have 15 to 35
NARROWEST_NM = 0.5
GRAZING = 1e-6  # height over distance, below which an LED does not stand before the object
PLACES = (("x", "y", "z"), ("azimuth_deg", "polar_deg"))
LIGHTS = (("wavelength_nm",), ("spectrum",))
PERHAPS = ("distance", "width_nm", "width_below_nm", "width_above_nm", "power", "intensity", "size", "name")
TEXT = ("spectrum", "name")


@dataclass(frozen=True)
class Led:
    """An LED of the table.

    Attributes
    ----------
    direction : (3,) float
        Unit vector from the scene's origin.
    distance : float or None
        From there [scene units]; None if it is far.
    power : float
        What a white patch at the origin that faces it gets.
    wavelength_nm, density : (n,) float
        Its spectrum [1/nm], of integral 1.
    size : float
        Width of a square LED [scene units]; 0 for a point.
    """

    direction: np.ndarray
    distance: float | None
    power: float
    wavelength_nm: np.ndarray
    density: np.ndarray
    size: float = 0.0


def read_leds(path: Path) -> list[Led]:
    """Read a table of LEDs.

    Raises
    ------
    InputError
        It can't be used; the sentence names the line.
    """
    names, lines = _read_csv(path)
    spectra: dict[str, tuple] = {}
    leds = []
    for number, cells in lines:
        where = f"{path}, line {number}"
        row = dict(zip(names, cells))
        value = {name: _number(where, name, text) for name, text in row.items() if name not in TEXT}
        direction, distance = _place(where, value)
        key = row.get("spectrum") or " ".join(row.get(n, "") for n in names if n.startswith("w"))
        if key not in spectra:
            spectra[key] = _file_spectrum(path, where, key) if "spectrum" in row else _peak(where, value)
        leds.append(
            Led(
                direction,
                distance,
                _power(where, value, distance),
                *spectra[key],
                _size(where, value, distance),
            )
        )
    return leds


def _read_csv(path: Path) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """Read names and lines; each line with its number in the file."""
    try:
        if regular(path).stat().st_size > LARGEST:
            raise ValueError("it is too large")
        text = path.read_text(encoding="utf-8-sig")
        mark = ";" if ";" in text else ","
        rows = list(csv.reader(io.StringIO(text, newline=""), delimiter=mark, strict=True))
    except (OSError, ValueError, csv.Error) as error:
        raise InputError(
            f"{path}: not a readable table of LEDs ({error}); write a CSV, a line per LED."
        ) from error
    rows = [(k, [cell.strip() for cell in row]) for k, row in enumerate(rows, 1)]
    rows = [(k, row) for k, row in rows if any(row) and not row[0].startswith("#")]
    names = [name.lower() for name in rows[0][1]] if rows else []
    _check_names(path, names)
    for number, row in rows[1:]:
        if len(row) != len(names):
            raise InputError(
                f"{path}, line {number}: it has {len(row)} cells, not {len(names)}; write all of them."
            )
    if not 2 <= len(rows) - 1 <= MOST_LED:
        raise InputError(f"{path}: it has {len(rows) - 1} LEDs; write 2 to {MOST_LED}, one a line.")
    return names, rows[1:]


def _check_names(path: Path, names: list[str]) -> None:
    """Refuse columns that are not known, come twice, or don't tell place and light in exactly one way."""
    known = {name for kind in (*PLACES, *LIGHTS) for name in kind} | set(PERHAPS)
    for name in names:
        if name not in known or names.count(name) > 1:
            what = "comes twice" if name in known else "is not known"
            raise InputError(
                f"{path}: the column {name[:40]!r} {what}; there are {', '.join(sorted(known))}."
            )
    for kinds, what in ((PLACES, "where LEDs stand"), (LIGHTS, "what light they give")):
        told = [kind for kind in kinds if set(kind) & set(names)]
        if len(told) != 1 or not set(told[0]) <= set(names):
            ways = " or ".join(" ".join(kind) for kind in kinds)
            raise InputError(f"{path}: its columns must tell in one way {what}; write {ways}.")
    excluded = (("power", "intensity"), ("width_nm", "width_below_nm"), ("x", "distance"))
    for one, other in (*excluded, *(("spectrum", name) for name in PERHAPS[1:4])):
        if one in names and other in names:
            raise InputError(f"{path}: the columns {one} and {other} tell the same; leave one out.")
    if ("width_below_nm" in names) != ("width_above_nm" in names):
        raise InputError(f"{path}: width_below_nm and width_above_nm go together; write both.")


def _number(where: str, name: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not abs(value) <= MOST:
        raise InputError(f"{where}: {name} is {text[:40]!r}; write a number, {MOST:g} at most.")
    return value


def _above(where: str, name: str, value: float) -> float:
    if not value >= 1 / MOST:
        raise InputError(f"{where}: {name} is {value:g}; it must be {1 / MOST:g} or more.")
    return value


def _place(where: str, value: dict[str, float]) -> tuple[np.ndarray, float | None]:
    """Give the direction and the distance of an LED."""
    if "x" in value:
        position = np.array([value[axis] for axis in "xyz"])
        distance = float(np.linalg.norm(position))
        _above(where, "the distance from the origin", distance)
        direction = position / distance
    else:
        azimuth, polar = np.radians([value["azimuth_deg"], value["polar_deg"]])
        direction = np.array(
            [np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)]
        )
        distance = _above(where, "distance", value["distance"]) if "distance" in value else None
    if not direction[2] > GRAZING:
        raise InputError(
            f"{where}: the LED does not stand before the object; z goes toward the camera, polar_deg below 90."
        )
    return direction, distance


def _power(where: str, value: dict[str, float], distance: float | None) -> float:
    if "intensity" not in value:
        return _above(where, "power", value.get("power", 1.0))
    if distance is None:
        raise InputError(f"{where}: a far LED has no intensity; write power, what reaches the object.")
    return _above(where, "intensity", value["intensity"]) / distance**2


def _size(where: str, value: dict[str, float], distance: float | None) -> float:
    size = value.get("size", 0.0)
    if size and (distance is None or not SMALLEST * distance <= size <= distance):
        raise InputError(
            f"{where}: size is {size:g}; only a near LED has one, smaller than its distance; 0 for a point."
        )
    return size


def _peak(where: str, value: dict[str, float]) -> tuple[np.ndarray, np.ndarray]:
    """Give the spectrum of an LED by its peak and widths."""
    peak = value["wavelength_nm"]
    if not RANGE_NM[0] <= peak <= RANGE_NM[1]:
        raise InputError(
            f"{where}: wavelength_nm is {peak:g}; light from {RANGE_NM[0]:g} to {RANGE_NM[1]:g} nm is rendered."
        )
    half = value.get("width_nm", WIDTH_NM) / 2
    widths = [value.get(f"width_{side}_nm", half) for side in ("below", "above")]
    if not all(NARROWEST_NM / 2 <= width <= RANGE_NM[1] for width in widths):
        raise InputError(
            f"{where}: an LED is {sum(widths):g} nm wide; write {NARROWEST_NM:g} or more, at half maximum."
        )
    return led_spectrum(peak, *widths)


def _file_spectrum(table: Path, where: str, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Read a measured spectrum; a line of names above the numbers is left out."""
    if not name:
        raise InputError(f"{where}: spectrum is empty; name a CSV of wavelength and light.")
    path = table.parent / name
    otherwise = "this is no spectrum; write a CSV of wavelength in nm and light, two columns"
    rows = read_numbers(path, otherwise)
    rows = rows[1:] if len(rows) and np.isnan(rows[0]).all() else rows
    if rows.shape[1] != 2 or len(rows) < 2 or not np.isfinite(rows).all():
        raise InputError(f"{path}: {otherwise}.")
    nm, light = rows.T
    if (np.diff(nm) <= 0).any() or light.min() < 0:
        raise InputError(
            f"{path}: its wavelengths must grow and its light be 0 or more; sort and correct it."
        )
    total = float(integrate(np.interp(WAVELENGTH_NM, nm, light, left=0.0, right=0.0)))
    if not 0 < total < np.inf:
        raise InputError(
            f"{path}: it has no light from {RANGE_NM[0]:g} to {RANGE_NM[1]:g} nm; write nanometres."
        )
    return nm, light / total
