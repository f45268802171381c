"""What is handed on: the maps of a fit, its surface, and how long its unit is."""

import importlib
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType

import numpy as np
import OpenEXR
import trimesh

from evsdr.errors import InputError
from evsdr.files.maps import read_results
from evsdr.model.view import MILLIMETRES, CameraGeometry
from evsdr.records import Maps


@dataclass(frozen=True)
class Source:
    """What a fit found, as other programs take it.

    Attributes
    ----------
    maps : Maps
        Bands in the order of their wavelengths.
    points : (H, W, 3) float64
        The surface in the camera frame: x right, y up, z toward the camera [`unit`]; 0 outside the maps' mask.
    face : (n_face, 3) int64
        Triangles of the surface, by the number of each corner among the pixels of the mask, row after row.
    unit : str
        mm, or `scene` where nobody tells how long the scene's unit is.
    pixel_mm : float or None
        Width of a pixel on the object [mm], where all have the same and the unit is known.
    camera : CameraGeometry
        Where the pixels look; sizes in the scene's unit.
    to_world : (4, 4) float64
        From the camera frame to the world [`unit`].
    """

    maps: Maps
    points: np.ndarray
    face: np.ndarray
    unit: str
    pixel_mm: float | None
    camera: CameraGeometry
    to_world: np.ndarray


def read_source(folder: Path, unit: str | None = None) -> Source:
    """Read the results of a fit, to hand them on.

    Parameters
    ----------
    folder : Path
        Where the fit wrote.
    unit : str, optional
        The scene's unit, one of `MILLIMETRES`; by default what the scene stated.

    Raises
    ------
    InputError
        A file is missing, damaged or of an older evsdr, or no pixel is known.
    """
    maps, summary = read_results(folder)
    if not maps.mask.any():
        raise InputError(
            f"{folder}: no pixel is known, so there is nothing to export; fit another recording."
        )
    older = InputError(f"{folder}: no surface with its camera is among these results; fit again.")
    if not {"depth.exr", "mesh.ply"} <= set(summary["files"]):
        raise older
    try:
        camera = _camera(summary["camera"])
        to_world = np.array(summary["camera"]["to_world"], float)
        length = MILLIMETRES.get(unit or summary["unit"])
        depth = OpenEXR.File(str(folder / "depth.exr")).channels()["Z"].pixels.astype(float)
        face = np.asarray(trimesh.load(folder / "mesh.ply", process=False).faces, int)
    except (KeyError, TypeError, ValueError, AttributeError, RuntimeError) as error:
        raise older from error
    if (
        to_world.shape != (4, 4)
        or depth.shape != maps.mask.shape
        or face.max(initial=0) >= np.count_nonzero(maps.mask)
    ):
        raise older
    points = np.where(maps.mask[..., None], camera.points(depth) * (length or 1), 0)
    to_world[:3, 3] *= length or 1
    flat = length and not camera.perspective
    return Source(
        _sorted(maps),
        points,
        face,
        "mm" if length else "scene",
        camera.pixel_size[0] * length if flat else None,
        camera,
        to_world,
    )


def library(name: str) -> ModuleType:
    """Import a library that only exports need.

    Raises
    ------
    InputError
        It is not installed.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        package = name.partition(".")[0]
        raise InputError(
            f"{package} is not installed; install it by: python -m pip install 'evsdr[export]'."
        ) from error


def _camera(told: dict) -> CameraGeometry:
    width, height = map(float, told["pixel_size"])
    column, row = map(float, told["center"])
    if not np.isfinite([width, height, column, row]).all():
        raise ValueError("a camera of no size")
    return CameraGeometry(bool(told["perspective"]), (width, height), (column, row))


def _sorted(maps: Maps) -> Maps:
    """Put the bands in the order of their wavelengths."""
    order = np.argsort(maps.band_wavelength_nm, kind="stable")
    return replace(
        maps,
        reflectance=maps.reflectance[..., order],
        reflectance_sigma=maps.reflectance_sigma[..., order],
        band_wavelength_nm=maps.band_wavelength_nm[order],
    )
