"""Write the textured surfaces: R(x, lambda) = sum_k a_k(x) b_k(lambda) with 1, 3 or 8 spectral bases.

`bases_1.xml`, `bases_3.xml` and `bases_8.xml` hold a diffuse bsdf with the id `surface`, a tree of stock
`blendbsdf`; their weights are the images `weight_0.png` to `weight_6.png`, which tile.
"""

from pathlib import Path
from textwrap import indent

import numpy as np
import png
from evsdr.scenes.formats import HERE
from scipy.special import expit, ndtr

from evsdr.rig.led_xml import spectrum_xml

WAVELENGTH_NM = np.arange(360.0, 831.0, 10.0)
N_WEIGHT = 7
SIZE = 256  # of a weight image [pixels]


def _peak(low: float, high: float, center_nm: float, width_nm: float) -> np.ndarray:
    return low + (high - low) * np.exp(-0.5 * ((WAVELENGTH_NM - center_nm) / width_nm) ** 2)


def _step(low: float, high: float, center_nm: float, width_nm: float) -> np.ndarray:
    return low + (high - low) * expit((WAVELENGTH_NM - center_nm) / width_nm)


def basis_spectra(n_basis: int) -> list[np.ndarray]:
    """Give the spectra at the leaves of the blend tree.

    Parameters
    ----------
    n_basis : {1, 3, 8}
        Number of spectral bases.

    Returns
    -------
    list of (48,) float
        Reflectance, 0.05 to 0.9, over `WAVELENGTH_NM`. With one basis these are two shades of one spectrum.
    """
    if n_basis == 1:
        ochre = _step(0.2, 0.88, 545, 28)
        return [0.3 * ochre, ochre]
    if n_basis == 3:
        return [_step(0.07, 0.82, 590, 18), _peak(0.1, 0.66, 520, 42), _peak(0.09, 0.8, 445, 40)]
    return [
        _peak(0.06, 0.75, 400, 18),
        _step(0.06, 0.85, 618, 8),
        _peak(0.06, 0.75, 492, 20),
        _step(0.08, 0.88, 579, 9),
        _peak(0.05, 0.75, 448, 18),
        _step(0.1, 0.9, 543, 12),
        _peak(0.06, 0.7, 527, 20),
        _peak(0.86, 0.1, 465, 20),
    ]


def _noise(rng: np.random.Generator, blob_size: float) -> np.ndarray:
    """Draw smooth noise of unit variance that tiles, (SIZE, SIZE); `blob_size` is a share of the image."""
    frequency = np.fft.fftfreq(SIZE) * SIZE
    squared = frequency[:, None] ** 2 + frequency[None, :] ** 2
    blur = np.exp(-0.5 * squared * (np.pi * blob_size) ** 2)
    noise = np.fft.ifft2(np.fft.fft2(rng.standard_normal((SIZE, SIZE))) * blur).real
    return (noise - noise.mean()) / noise.std()


def weight_image(k: int) -> np.ndarray:
    """Draw a blend weight: soft blotches, some with a sharp edge.

    Parameters
    ----------
    k : int
        Number of the image; its seed.

    Returns
    -------
    (256, 256) uint8
        Weight, 255 is 1.
    """
    rng = np.random.default_rng(1000 + k)
    soft, region = _noise(rng, 0.09), _noise(rng, 0.13)
    edge = np.tanh(region / (1.5 * np.std(np.gradient(region))))  # about three pixels wide
    return np.round(255 * ndtr(1.1 * soft + 1.3 * edge)).astype(np.uint8)


def _leaf(spectrum: np.ndarray, name: str) -> str:
    inner = indent(spectrum_xml(WAVELENGTH_NM, spectrum, name="reflectance"), "    ")
    return f'<bsdf type="diffuse"{name}>\n{inner}\n</bsdf>'


def _tree(spectra: list[np.ndarray], first_weight: int, name: str) -> str:
    """Blend the first half of the spectra with the second; a tree of n leaves takes n - 1 weights."""
    if len(spectra) == 1:
        return _leaf(spectra[0], name)
    half = len(spectra) // 2
    inner = [
        f'<ref name="weight" id="weight_{first_weight}"/>',
        _tree(spectra[:half], first_weight + 1, ' name="bsdf_0"'),
        _tree(spectra[half:], first_weight + half, ' name="bsdf_1"'),
    ]
    return f'<bsdf type="blendbsdf"{name}>\n' + indent("\n".join(inner), "    ") + "\n</bsdf>"


def surface_xml(n_basis: int) -> str:
    """Write the surface with `n_basis` spectral bases."""
    spectra = basis_spectra(n_basis)
    part = [
        f"<!-- Diffuse surface with spectral rank {n_basis}. Written by make_surfaces.py. -->",
        '<default name="tile_u" value="1"/>',
    ]
    for k in range(len(spectra) - 1):
        part.append(
            f'<texture type="bitmap" id="weight_{k}">\n'
            f'    <string name="filename" value="weight_{k}.png"/>\n'
            '    <boolean name="raw" value="true"/>\n'
            '    <transform name="to_uv">\n'
            '        <scale x="$tile_u" y="1"/>\n'
            "    </transform>\n"
            "</texture>"
        )
    part.append(_tree(spectra, 0, ' id="surface"'))
    return '<scene version="3.0.0">\n' + indent("\n\n".join(part), "    ") + "\n</scene>\n"


def write(folder: Path = HERE) -> None:
    """Write the surfaces and their weight images."""
    for n_basis in (1, 3, 8):
        (folder / f"bases_{n_basis}.xml").write_text(surface_xml(n_basis))
    for k in range(N_WEIGHT):
        png.from_array(weight_image(k), "L").save(folder / f"weight_{k}.png")


if __name__ == "__main__":
    write()
