"""Write evsdr/files/daylight.csv from the tables of colour-science.

python -m experiments.daylight_table
"""

import warnings

import numpy as np

from evsdr.files.daylight import TABLE


def rgb_of_wavelengths() -> tuple[np.ndarray, np.ndarray]:
    """Give wavelengths [nm] and the linear sRGB of daylight that a surface reflects at each alone.

    Observer times D65 where the tables of both overlap, over the luminance of a white surface, times the matrix
    of sRGB (IEC 61966-2-1).
    """
    with np.printoptions(), warnings.catch_warnings():  # the import sets both, and warns of absent extras
        warnings.simplefilter("ignore")
        import colour
    nm = np.arange(360.0, 781.0, 5.0)
    observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    xyz = observer[nm] * colour.SDS_ILLUMINANTS["D65"][nm][:, None]
    return nm, colour.XYZ_to_RGB(xyz / xyz[:, 1].sum(), "sRGB")


def main() -> None:
    """Write the table."""
    nm, rgb = rgb_of_wavelengths()
    lines = [f"{at:.0f},{r:.9e},{g:.9e},{b:.9e}" for at, (r, g, b) in zip(nm, rgb)]
    TABLE.write_text("wavelength_nm,red,green,blue\n" + "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
