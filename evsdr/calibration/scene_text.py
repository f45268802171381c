"""Scene files as text: one file with all includes in it, and LEDs with measured places and powers."""

import copy
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from evsdr.errors import InputError

SPECTRUM_OF = {"directional": "irradiance", "point": "intensity", "area": "radiance"}
NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"


def flatten(path: Path, define: dict[str, str]) -> ET.Element:
    """Read a scene file with its includes in place, its `$names` replaced, and absolute file names.

    Parameters
    ----------
    path : Path
        The scene file.
    define : dict
        Values that win over the file's `<default>` elements.

    Raises
    ------
    InputError
        A file is missing, or is no XML.
    """
    values, root = dict(define), ET.Element("scene", version="3.0.0")
    root.extend(_elements(path, path.parent, values))
    return root


def _elements(path: Path, home: Path, values: dict[str, str]) -> list[ET.Element]:
    try:
        file = ET.parse(path).getroot()
    except (OSError, ET.ParseError) as error:
        raise InputError(f"{path}: not a readable scene file ({error}); correct it.") from error
    found = []
    for element in file:
        if element.tag == "default":
            values.setdefault(element.get("name", ""), _substitute(element.get("value", ""), values))
            continue
        for part in element.iter():
            for name, text in part.attrib.items():
                part.set(name, _substitute(text, values))
            if part.tag == "string" and part.get("name") == "filename":
                part.set("value", str(_resolve(part.get("value", ""), home, path)))
        if element.tag == "include":
            found += _elements(_resolve(element.get("filename", ""), home, path), home, values)
        else:
            found.append(element)
    return found


def _substitute(text: str, values: dict[str, str]) -> str:
    return re.sub(r"\$(\w+)", lambda match: values.get(match[1], match[0]), text)


def _resolve(name: str, home: Path, path: Path) -> Path:
    """Find a file beside the scene, or beside the file that names it."""
    return next((p for p in (home / name, path.parent / name) if p.is_file()), home / name).resolve()


def find_leds(root: ET.Element) -> list[ET.Element]:
    """Copy the LEDs of a flat scene in schedule order, each complete in itself.

    Returns
    -------
    list of Element
        Emitters, or shapes with an area emitter, whose id starts with `led`.
    """
    named = {e.get("id"): e for e in root if e.get("id")}
    leds = [e for e in root if e.tag in ("emitter", "shape") and e.get("id", "").startswith("led")]
    leds = sorted(leds, key=lambda e: [int(s) if s.isdigit() else s for s in re.split(r"(\d+)", e.get("id"))])
    return [_complete(copy.deepcopy(led), named) for led in leds]


def _complete(element: ET.Element, named: dict[str, ET.Element]) -> ET.Element:
    """Put what `<ref>` names in its place."""
    for k, child in enumerate(element):
        if child.tag == "ref" and child.get("id") in named:
            part = copy.deepcopy(named[child.get("id")])
            part.attrib.pop("id")
            if child.get("name"):
                part.set("name", child.get("name"))
            element[k] = child = part
        _complete(child, named)
    return element


def place_led(led: ET.Element, direction: np.ndarray | None, position: np.ndarray | None) -> ET.Element:
    """Give a copy of an LED at another place: a far LED by its direction, a point LED by its position.

    Parameters
    ----------
    led : Element
        As `find_leds` gives it.
    direction : (3,) float, optional
        Unit vector from surface to light, in the world.
    position : (3,) float, optional
        Place in the world [scene units].

    Raises
    ------
    InputError
        The LED is a shape.
    """
    kind = led.get("type")
    if led.tag != "emitter" or kind not in ("directional", "point"):
        raise InputError(
            f"{led.get('id')} is a shape that shines, which has no single place; "
            "write the LEDs as directional or point emitters to calibrate them."
        )
    kept = [c for c in led if c.get("name") not in ("direction", "position", "to_world")]
    if position is None:
        tag, name, v = "vector", "direction", -np.asarray(direction)
        kind_now = "directional"
    else:
        tag, name, v, kind_now = "point", "position", position, "point"
    moved = ET.Element("emitter", type=kind_now, id=led.get("id"))
    ET.SubElement(moved, tag, name=name, **{axis: f"{c:.7g}" for axis, c in zip("xyz", v)})
    for child in map(copy.deepcopy, kept):
        if child.get("name") == SPECTRUM_OF[kind]:
            child.set("name", SPECTRUM_OF[kind_now])
        moved.append(child)
    return moved


def scale_led(led: ET.Element, factor: float) -> ET.Element:
    """Give a copy of an LED whose spectrum is multiplied by a factor.

    Raises
    ------
    InputError
        The spectrum is not written as numbers.
    """
    scaled = copy.deepcopy(led)
    for part in scaled.iter():
        if part.get("name") in SPECTRUM_OF.values():
            _scale_spectrum(part, factor, led.get("id"))
            return scaled
    raise InputError(f"{led.get('id')}: it has no spectrum to scale; write its irradiance or intensity.")


def _scale_spectrum(part: ET.Element, factor: float, name: str) -> None:
    values = next((s for s in part if s.get("name") == "values"), None)
    where = part if values is None else values
    text = where.get("value")
    if text is None:
        raise InputError(
            f"{name}: its spectrum of type {part.get('type')} can't be scaled; "
            "write it as wavelength:value pairs."
        )
    pattern = rf"(?<=:)\s*{NUMBER}" if ":" in text else NUMBER
    where.set("value", re.sub(pattern, lambda match: f"{factor * float(match[0]):.7g}", text))


def include_text(title: str, elements: list[ET.Element], default: dict[str, float] | None = None) -> str:
    """Write an include file.

    Parameters
    ----------
    title : str
        What the file says of itself.
    elements : list of Element
        Its content.
    default : dict, optional
        Values of `<default>` elements. Mitsuba takes the first it meets, so the include must come first.
    """
    root = ET.Element("scene", version="3.0.0")
    root.append(ET.Comment(f" {title} "))
    for name, value in (default or {}).items():
        ET.SubElement(root, "default", name=name, value=f"{value:.7g}")
    root.extend(copy.deepcopy(element) for element in elements)
    ET.indent(root, "    ")
    return ET.tostring(root, encoding="unicode") + "\n"
