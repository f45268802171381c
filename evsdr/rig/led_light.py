"""The light of LEDs: spectra by a few figures, and what a square LED sends."""

import numpy as np

STEP_NM = 5.0
STEPS_PER_WIDTH = 3  # at least, of a spectrum's full width at half maximum
RANGE_NM = (360.0, 830.0)  # that Mitsuba renders
LEAST = 1e-3  # of the peak, from which light is written


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
        Wavelengths [nm] in steps of 5 nm, finer for narrow peaks, and irradiance [W/m^2/nm] that integrates to 1 W/m^2.
    """
    width_per_half = 2.17  # (g + 2 g^5) / 3 is one half at width / 2.17
    step = min(STEP_NM, (left_nm + right_nm) / STEPS_PER_WIDTH)
    wavelength = np.arange(RANGE_NM[0], RANGE_NM[1] + 0.2 * step, step)
    shift = wavelength - peak_nm
    g = np.exp(-((shift / (width_per_half * np.where(shift < 0, left_nm, right_nm))) ** 2))
    density = (g + 2 * g**5) / 3
    used = np.flatnonzero(density > LEAST)
    used = np.arange(max(used[0] - 1, 0), min(used[-1] + 2, len(wavelength)))
    density = np.where(density > LEAST, density, 0.0)[used]
    return wavelength[used], density / np.trapezoid(density, wavelength[used])


def square_form_factor(width: float, distance: float) -> float:
    """Form factor from a small patch to a square that it faces: irradiance is pi times it times radiance.

    Four corner rectangles, each as in Howell, "A catalog of radiation heat transfer configuration factors",
    B-3.
    """
    x = 0.5 * width / distance
    root = np.sqrt(1 + x * x)
    return 4 * x / root * np.arctan(x / root) / np.pi
