"""`calibrate reference` and `calibrate scale`: read, estimate, write."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from evsdr.calibration import chart as colours
from evsdr.calibration import draw
from evsdr.calibration.scene_text import include_text
from evsdr.errors import InputError
from evsdr.files.arrays import read_npy
from evsdr.files.maps import read_maps
from evsdr.light.entry import open_scene

TWELVE = tuple(str(k) for k in range(1, 13))


def reference(
    folder: Path,
    scene: Path,
    spectra: str = "babel",
    patches: Sequence[str] = TWELVE,
    reserved: str | None = "19",
    white: str | None = None,
    white_reflectance: float = 1.0,
    define: dict[str, str] | None = None,
) -> dict:
    """Project measured spectra on the bands of a ring.

    Parameters
    ----------
    folder : Path
        Gets reference.csv, reserved.csv and residuals.png.
    scene : Path
        Scene file with the LEDs.
    spectra : str
        A CSV, `babel` or `ohta`; see `chart.read_spectra`.
    patches : sequence of str
        Names or numbers of the patches to evaluate.
    reserved : str, optional
        Name or number of the patch that sets the scale.
    white : str, optional
        Column with the white patch, where the columns are intensities under one light.
    white_reflectance : float
        Of that patch.
    define : dict, optional
        Values for the `<default>` parameters of the scene file.

    Returns
    -------
    dict
        Every value and its sigma, as calibration.json holds them.

    Raises
    ------
    InputError
        Something given can't be used.
    """
    ring = open_scene(scene, define)
    measured = colours.read_spectra(spectra)
    if white:
        measured = colours.over_white(measured, white, white_reflectance)
    bands = ring.leds.band_spectrum
    everything = colours.project(measured, bands)
    table = colours.choose(everything, list(patches))
    colours.write_patches(folder / "reference.csv", table)
    if reserved:
        colours.write_patches(folder / "reserved.csv", colours.choose(everything, [reserved]))
    draw.draw_reference(folder / "residuals.png", measured, table, bands, colours.WAVELENGTH_NM)
    result = {
        "scene": str(scene),
        "spectra": spectra,
        "band_nm": table.band_nm.tolist(),
        "patches": [
            {"name": name, "number": int(number), "reflectance": value.tolist(), "sigma": sigma.tolist()}
            for name, number, value, sigma in zip(table.name, table.number, table.value, table.sigma)
        ],
    }
    return result


@dataclass(frozen=True)
class Patches:
    """Where the patches of a chart are seen.

    Attributes
    ----------
    corners : (8,) float or None
        Column and row of the chart's four corners [pixels]: at patch 1, then clockwise.
    rows, columns : int
        Of patches.
    gap : float
        Border between patches and around them, in widths of a patch.
    labels : Path or None
        Instead of corners: a .npy image with the number of the patch at each pixel, 0 for none.
    """

    corners: tuple[float, ...] | None = None
    rows: int = 4
    columns: int = 6
    gap: float = 0.0
    labels: Path | None = None


def scale(
    folder: Path,
    maps: Path,
    reference: Path,
    reserved: Path,
    patches: Patches,
    constant_light: float | None = None,
) -> dict:
    """Find the absolute scale of maps from a reserved patch of a chart, judge the others.

    Parameters
    ----------
    folder : Path
        Gets evaluation.csv, residuals.png, and constant_light.xml if C_w is given.
    maps : Path
        maps.npz of the chart.
    reference, reserved : Path
        Tables of the patches to evaluate, and of the one that sets the scale; see `reference`.
    patches : Patches
    constant_light : float, optional
        C_w that the fit used.

    Returns
    -------
    dict
        Every estimate and its sigma, as calibration.json holds them.

    Raises
    ------
    InputError
        Something given can't be used.
    """
    fitted = read_maps(maps)
    shape = fitted.mask.shape
    if patches.labels:
        label = _read_labels(patches.labels, shape)
    elif patches.corners:
        corner = np.array(patches.corners).reshape(4, 2)
        label = colours.chart_labels(corner, shape, patches.rows, patches.columns, patches.gap)
    else:
        raise InputError("nothing tells where the patches are; give --corners or --labels.")
    table = colours.read_patches(reference)
    found = colours.find_scale(fitted, label, colours.read_patches(reserved), table)
    colours.write_patches(folder / "evaluation.csv", found.measured)
    if constant_light is not None:
        light = constant_light * found.scale
        text = include_text(
            "Constant light as evsdr.calibrate scale found it; include it before any other default.",
            [],
            {"constant_light": light},
        )
        (folder / "constant_light.xml").write_text(text)
    draw.draw_scale(folder / "residuals.png", found, table)
    result = {
        "maps": str(maps),
        "scale": {"value": found.scale, "sigma": found.sigma},
        "reserved": {"name": found.reserved.name[0], "number": int(found.reserved.number[0])},
        "rmse": float(found.rmse.mean()),
        "sam_deg": float(found.sam_deg.mean()),
        "patches": [
            {
                "name": name,
                "number": int(number),
                "rmse": float(rmse),
                "sam_deg": float(sam),
                "reflectance": value.tolist(),
                "sigma": sigma.tolist(),
            }
            for name, number, rmse, sam, value, sigma in zip(
                table.name,
                table.number,
                found.rmse,
                found.sam_deg,
                found.measured.value,
                found.measured.sigma,
            )
        ],
    }
    if constant_light is not None:
        result["constant_light"] = {"value": light, "sigma": constant_light * found.sigma}
    return result


def _read_labels(path: Path, shape: tuple[int, int]) -> np.ndarray:
    label = read_npy(path, "save the numbers of the patches by numpy.save")
    if label.shape != shape or label.dtype.kind not in "iu":
        raise InputError(
            f"{path}: labels must be whole numbers of shape (height, width) = {shape}; save them so."
        )
    return label
