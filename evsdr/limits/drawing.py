"""Draw a ring in millimetres, to drill and bend by: its face, a section, and where each LED goes."""

import numpy as np

HOLE_MM = 5.2  # of a 5 mm LED
MARGIN_MM = 12.0
ROW_MM = 4.6  # of the table
TABLE_MM = 108.0
TEXT_MM = 3.0

# Colours of the holes by wavelength [nm]; between them the nearer one.
COLOURS = {
    405: "#7a3cff",
    430: "#4a4cff",
    460: "#0a6cff",
    490: "#00a8c8",
    525: "#00a24a",
    560: "#7fae00",
    595: "#e89a00",
    635: "#d8281e",
}


def positions_mm(leds: list[dict], distance_mm: float) -> np.ndarray:
    """Give where the LEDs are, all as far from the centre of the object, camera frame: (n_led, 3) [mm].

    Parameters
    ----------
    leds : list of dict
        `azimuth_deg` and `polar_deg` of each, as design.json holds them.
    distance_mm : float
        Of each LED from the centre of the object.
    """
    azimuth, polar = (np.radians([led[name] for led in leds]) for name in ("azimuth_deg", "polar_deg"))
    return distance_mm * np.stack(
        [np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=1
    )


def ring_drawing(leds: list[dict], distance_mm: float) -> str:
    """Give the drawing as the text of an SVG in millimetres: printed at 100 %, the face is a template.

    Parameters
    ----------
    leds : list of dict
        `id`, `centroid_nm`, `azimuth_deg` and `polar_deg` of each, as design.json holds them.
    distance_mm : float
        Of each LED from the centre of the object.
    """
    at = positions_mm(leds, distance_mm)
    radius = np.hypot(at[:, 0], at[:, 1])
    outer = radius.max() + 2 * HOLE_MM
    inner = max(radius.min() - 2 * HOLE_MM, 0.0)
    width = 2 * outer + 3 * MARGIN_MM + TABLE_MM
    face = _face(leds, at, inner, outer)
    section, section_mm = _section(leds, at, outer)
    height = max(2 * outer + 4 * MARGIN_MM + section_mm, (len(leds) + 3) * ROW_MM + 4 * MARGIN_MM)
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.1f}mm" height="{height:.1f}mm" '
            f'viewBox="0 0 {width:.1f} {height:.1f}" font-family="Helvetica, Arial, sans-serif" font-size="{TEXT_MM}">',
            "<title>Ring of LEDs: face, section, table; millimetres</title>",
            '<rect width="100%" height="100%" fill="white"/>',
            _group(MARGIN_MM + outer, 2 * MARGIN_MM + outer, face),
            _group(MARGIN_MM + outer, 3 * MARGIN_MM + 2 * outer, section),
            _group(2 * MARGIN_MM + 2 * outer, 2 * MARGIN_MM, _table(leds, at)),
            _text(
                MARGIN_MM, MARGIN_MM, f"Ring of {len(leds)} LEDs, each {distance_mm:g} mm from the object", 5
            ),
            "</svg>",
            "",
        ]
    )


def _face(leds: list[dict], at: np.ndarray, inner: float, outer: float) -> list[str]:
    """Draw the ring as the camera sees it from behind: x right, y up."""
    radius = np.hypot(at[:, 0], at[:, 1])
    parts = [_circle(0, 0, outer), _circle(0, 0, inner), _line(-5, 0, 5, 0), _line(0, -5, 0, 5)]
    parts += [_circle(0, 0, r, dashed=True) for r in np.unique(radius.round(2))]
    for led, (x, y, _), r in zip(leds, at, radius):
        parts.append(_circle(x, -y, HOLE_MM / 2, fill=_colour(led["centroid_nm"])))
        far = (r + 1.45 * HOLE_MM) / r if r else 0.0
        parts.append(_text(x * far, -y * far + TEXT_MM / 3, _number(led), middle=True))
    parts.append(_text(0, -outer - 2, "face, as the camera sees it; LEDs shine away from you", middle=True))
    parts.append(
        _text(
            0,
            4 * TEXT_MM,
            f"holes of {HOLE_MM:g} mm on {_list(2 * np.unique(radius.round(1)))} mm",
            middle=True,
        )
    )
    parts.append(
        _text(
            0, -3 * TEXT_MM, f"hole for the camera {2 * inner:.1f}, outside {2 * outer:.1f} mm", middle=True
        )
    )
    return parts


def _section(leds: list[dict], at: np.ndarray, outer: float) -> tuple[list[str], float]:
    """Draw the ring from the side, the object below; give the height, too [mm]."""
    top = at[:, 2].max() + MARGIN_MM
    parts = [
        _line(-outer, top, outer, top, True),
        _text(outer, top - 1, "object", right=True),
        _circle(0, top, 1.5, fill="#333"),
    ]
    for polar, height in sorted({(round(led["polar_deg"], 1), round(p[2], 1)) for led, p in zip(leds, at)}):
        side = at[np.isclose(at[:, 2], height, atol=0.1)]
        x, y = np.hypot(side[0, 0], side[0, 1]), top - height
        parts += [_line(-x - 5, y, x + 5, y), _line(x, y, 0, top, True), _line(-x, y, 0, top, True)]
        parts += [_circle(sign * x, y, HOLE_MM / 2, fill="#bbb") for sign in (-1, 1)]
        parts.append(
            _text(
                0,
                y - 1.5,
                f"{height:.1f} mm above the object; LEDs tilted {polar:.1f} deg inwards",
                middle=True,
            )
        )
    return parts, top + MARGIN_MM


def _table(leds: list[dict], at: np.ndarray) -> list[str]:
    """List the LEDs, with the chip and the output that firmware/netlist.csv gives them."""
    columns = (0, 14, 30, 46, 62, 78, 92)
    rows = [("LED", "nm", "x mm", "y mm", "z mm", "azimuth", "chip, pin")]
    for j, (led, (x, y, z)) in enumerate(zip(leds, at)):
        place = f"U{1 + 2 * (j % 2) + j // 16}, OUT{j // 2 % 8}" if len(leds) <= 24 else ""
        rows.append(
            (
                _number(led),
                f"{led['centroid_nm']:.0f}",
                *(f"{round(v, 1) + 0.0:.1f}" for v in (x, y, z)),
                f"{led['azimuth_deg']:.1f}",
                place,
            )
        )
    return [
        _text(column, k * ROW_MM, word) for k, row in enumerate(rows) for column, word in zip(columns, row)
    ] + [_line(0, 1.2, TABLE_MM, 1.2)]


# ---- shapes -----------------------------------------------------------------------------------------------


def _number(led: dict) -> str:
    return led["id"].rpartition("_")[2].lstrip("0") or "0"


def _colour(nm: float) -> str:
    return COLOURS[min(COLOURS, key=lambda known: abs(known - nm))]


def _list(values: np.ndarray) -> str:
    return ", ".join(f"{value:.1f}" for value in values)


def _group(x: float, y: float, parts: list[str]) -> str:
    return f'<g transform="translate({x:.2f} {y:.2f})">\n' + "\n".join(parts) + "\n</g>"


def _circle(x: float, y: float, radius: float, fill: str = "none", dashed: bool = False) -> str:
    dash = ' stroke-dasharray="2 1.5"' if dashed else ""
    return f'<circle cx="{x:.2f}" cy="{y:.2f}" r="{radius:.2f}" fill="{fill}" stroke="#333" stroke-width="0.25"{dash}/>'


def _line(x0: float, y0: float, x1: float, y1: float, dashed: bool = False) -> str:
    dash = ' stroke-dasharray="2 1.5"' if dashed else ""
    return f'<path d="M{x0:.2f} {y0:.2f}L{x1:.2f} {y1:.2f}" stroke="#333" stroke-width="0.25"{dash}/>'


def _text(
    x: float, y: float, words: str, size: float = TEXT_MM, middle: bool = False, right: bool = False
) -> str:
    anchor = "middle" if middle else "end" if right else "start"
    return f'<text x="{x:.2f}" y="{y:.2f}" font-size="{size}" text-anchor="{anchor}">{words}</text>'
