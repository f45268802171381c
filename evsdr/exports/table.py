"""A table of the known pixels, as CSV."""

from pathlib import Path

import numpy as np

from evsdr.exports.source import Source


def write_csv(folder: Path, source: Source) -> None:
    """Write `pixels.csv`: a line of names, then a line for each known pixel, row after row.

    Position and normal are in the camera frame. `scale_known` is 1 where the absolute scale of reflectance is known.
    """
    maps, mask = source.maps, source.maps.mask
    bands = [f"{b}_{nm:.6g}nm" for b, nm in enumerate(maps.band_wavelength_nm)]
    columns = {
        ("row", "column"): np.argwhere(mask),
        tuple(f"{axis}_{source.unit}" for axis in "xyz"): source.points[mask],
        tuple(f"normal_{axis}" for axis in "xyz"): maps.normal[mask],
        ("normal_sigma_deg",): maps.normal_sigma_deg[mask][:, None],
        tuple(f"reflectance_{band}" for band in bands): maps.reflectance[mask],
        tuple(f"sigma_{band}" for band in bands): maps.reflectance_sigma[mask],
        ("scale_known",): maps.mask_reflectance[mask][:, None],
    }
    header = ",".join(name for names in columns for name in names)
    table = np.concatenate([np.asarray(values, float) for values in columns.values()], axis=1)
    np.savetxt(folder / "pixels.csv", table, fmt="%.8g", delimiter=",", header=header, comments="")
