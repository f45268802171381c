"""Write the ColorChecker: its mesh (colorchecker.ply) and its surface (colorchecker_surface.xml).

Chart and patches are one mesh, so the surface must tell them apart. Patch i has u in (i/32, (i+1)/32) and
v below one half; a tree of stock `checkerboard` textures, one level per binary digit of i, then picks the
patch's spectrum exactly.
"""

from pathlib import Path
from textwrap import indent

import colour
import numpy as np
from evsdr.scenes.formats import HERE, Mesh, write_ply

from evsdr.rig.led_xml import spectrum_xml

WAVELENGTH_NM = np.arange(360.0, 831.0, 10.0)
N_ROW, N_COLUMN = 4, 6
N_DIGIT = 5
BORDER = N_ROW * N_COLUMN  # follows the patches
BORDER_REFLECTANCE = 0.04
PATCH, GAP = 0.28, 0.04  # side of a patch, and width of the border around each


def patch_spectra() -> np.ndarray:
    """Give the reflectance of the 24 patches.

    Average of 30 charts (BabelColor, 2012), 380 to 730 nm, as `colour` has it; constant beyond.

    Returns
    -------
    (24, 48) float
        Row by row from the top left patch, over `WAVELENGTH_NM`.
    """
    chart = colour.SDS_COLOURCHECKERS["BabelColor Average"]
    return np.array([np.interp(WAVELENGTH_NM, sd.wavelengths, sd.values) for sd in chart.values()])


def chart() -> Mesh:
    """Make the chart in the plane z = 0, centred: 117 rectangles, patches and the border between them.

    Returns
    -------
    Mesh
        Rectangle k has the vertices 4 k to 4 k + 3.
    """
    x = np.concatenate([[0], np.cumsum([GAP, *[PATCH, GAP] * N_COLUMN])])
    y = np.concatenate([[0], np.cumsum([GAP, *[PATCH, GAP] * N_ROW])])
    x, y = x - x[-1] / 2, y[-1] / 2 - y
    corner = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])  # (column, row), clockwise with row 0 on top
    position, uv = [], []
    for row in range(len(y) - 1):
        for column in range(len(x) - 1):
            is_patch = row % 2 and column % 2
            patch = row // 2 * N_COLUMN + column // 2 if is_patch else BORDER
            position += [(x[column + c], y[row + r], 0) for c, r in corner]
            uv += [((patch + 0.25 + 0.5 * c) / 2**N_DIGIT, 0.125 + 0.25 * r) for c, r in corner]
    first = np.arange(0, len(position), 4)[:, None]
    face = np.concatenate([first + [0, 2, 1], first + [0, 3, 2]])
    return Mesh(np.array(position), np.tile([0.0, 0.0, 1.0], (len(position), 1)), np.array(uv), face)


def _choose(spectra: np.ndarray, digit: int, name: str) -> str:
    """Pick by the binary digits from `digit` down; a branch with one spectrum left needs no choice."""
    if len(spectra) == 1:
        return spectrum_xml(WAVELENGTH_NM, spectra[0], name=name)
    half = 2**digit
    if len(spectra) <= half:
        return _choose(spectra, digit - 1, name)
    inner = [
        f'<transform name="to_uv"><scale x="{2**N_DIGIT // (2 * half)}" y="1"/></transform>',
        _choose(spectra[:half], digit - 1, "color0"),
        _choose(spectra[half:], digit - 1, "color1"),
    ]
    inner = indent("\n".join(inner), "    ")
    return f'<texture type="checkerboard" name="{name}">\n{inner}\n</texture>'


def surface_xml() -> str:
    """Write the surface, a diffuse bsdf with the id `surface`."""
    border = np.full((1, len(WAVELENGTH_NM)), BORDER_REFLECTANCE)
    tree = _choose(np.concatenate([patch_spectra(), border]), N_DIGIT - 1, "reflectance")
    return (
        '<scene version="3.0.0">\n'
        "    <!-- The 24 patches of a ColorChecker and its border. Written by make_colorchecker.py. -->\n"
        '    <bsdf type="diffuse" id="surface">\n' + indent(tree, "        ") + "\n    </bsdf>\n</scene>\n"
    )


def write(folder: Path = HERE) -> None:
    """Write mesh and surface."""
    write_ply(folder / "colorchecker.ply", chart())
    (folder / "colorchecker_surface.xml").write_text(surface_xml())


if __name__ == "__main__":
    write()
