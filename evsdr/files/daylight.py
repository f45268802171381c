"""How reflectance looks under daylight: CIE 1931 standard observer, D65, sRGB.

`daylight.csv` is written by `experiments/daylight_table.py` from the tables of colour-science, which is slow to
import.
"""

from pathlib import Path

import numpy as np

TABLE = Path(__file__).with_name("daylight.csv")


def read_table() -> tuple[np.ndarray, np.ndarray]:
    """Read what each wavelength gives.

    Returns
    -------
    wavelength_nm : (n,) float64
        360 to 780 [nm], in equal steps.
    rgb : (n, 3) float64
        Linear sRGB of a surface that reflects daylight at this wavelength alone; a white one is their sum,
        (1, 1, 1) nearly.
    """
    table = np.loadtxt(TABLE, delimiter=",", skiprows=1)
    return table[:, 0], table[:, 1:]


def reflectance_to_srgb(reflectance: np.ndarray, wavelength_nm: np.ndarray) -> np.ndarray:
    """Show reflectance as it looks under daylight (D65), to the CIE 1931 standard observer.

    Reflectance is interpolated linearly between the bands and is constant beyond the outermost ones. One or
    two bands tell no colour: their mean becomes a grey.

    Parameters
    ----------
    reflectance : (..., n_band) float
        Reflectance per band.
    wavelength_nm : (n_band,) float
        Centroids [nm] in any order; bands that share one are averaged.

    Returns
    -------
    (..., 3) float64
        sRGB (IEC 61966-2-1), clipped to 0..1.
    """
    linear = np.clip(reflectance @ daylight_weights(wavelength_nm), 0, 1)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def daylight_weights(wavelength_nm: np.ndarray) -> np.ndarray:
    """Give linear sRGB (n_band, 3) of a surface that reflects daylight in one band alone, see `reflectance_to_srgb`."""
    centre, index = np.unique(wavelength_nm, return_inverse=True)
    if len(centre) < 3:
        return np.full((len(wavelength_nm), 3), 1 / len(wavelength_nm))
    nm, rgb = read_table()
    average = (index == np.arange(len(centre))[:, None]) / np.bincount(index)[:, None]
    return np.stack([np.interp(nm, centre, column) for column in average.T]) @ rgb
