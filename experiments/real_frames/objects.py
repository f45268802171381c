"""Frames of things under known lights, made by others, in one form.

Ball: DiLiGenT, Shi et al., "A Benchmark Dataset and Evaluation for Non-Lambertian and Uncalibrated Photometric
Stereo", CVPR 2016; the object "ball", cropped. Photographs.
Bunny: Y. Matsushita, RobustPhotometricStereo, as in Ikehata et al., "Robust Photometric Stereo using Sparse Regression",
CVPR 2012. Rendered, not photographed, but by other hands: matt with attached shadows alone; with its own soft shadows,
too, which take 5 % of the light where it falls at 50 degrees and half at 80; and glossy.
"""

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

REPOSITORY = Path(__file__).resolve().parents[2]
MEDIAN_REFLECTANCE = 0.5  # assumed: frames don't tell their absolute scale
BUNNY_RING = slice(25, 50)  # lights 46 degrees off the axis; the other 25 are 16 degrees off it


@dataclass(frozen=True)
class Frames:
    """Frames of an object.

    Attributes
    ----------
    signal : (n, H, W) float64
        Grey value in units of a white patch that faces its light.
    light_direction : (n, 3) float64
        Unit vectors from surface to light; x right, y up, z toward the camera.
    normal : (H, W, 3) float32
        True normals, same frame.
    mask : (H, W) bool
        Where the object is.
    ring : (n_led,) int
        The frames whose lights make a ring, in order of azimuth.
    """

    signal: np.ndarray
    light_direction: np.ndarray
    normal: np.ndarray
    mask: np.ndarray
    ring: np.ndarray

    def thinned(self, step: int) -> "Frames":
        """Keep each so many-th row and column."""
        some = np.s_[..., ::step, ::step]
        normal = self.normal[::step, ::step]
        return replace(self, signal=self.signal[some], normal=normal, mask=self.mask[some])


def data_folder() -> Path:
    """Say where the frames should be: in $EVSDR_DATA, else in ../shared/data beside the repository."""
    return Path(os.environ.get("EVSDR_DATA") or REPOSITORY.parent / "shared/data")


def read_ball(path: Path) -> Frames:
    """Read the photographs: mean of the channels, each divided by its light's intensity."""
    with np.load(path) as file:
        signal = np.mean(file["images"] / 65535 / file["light_int"][:, None, None], axis=-1)
        light, normal, mask = file["light_dir"], file["normal_gt"], file["mask"] != 0
    light = light / np.linalg.norm(light, axis=1, keepdims=True)
    return _scaled(Frames(signal, light, normal, mask, rim_order(light)))


def read_bunny(path: Path, surface: str) -> Frames:
    """Read the renders of a surface: `lambert_noshadow`, `lambert` or `specular`."""
    with np.load(path) as file:
        signal = file[f"bunny_{surface}"] * float(file[f"bunny_{surface}_scale"])
        light, normal, mask = file["light_dir"], file["normal_gt"], file["mask"] != 0
    some = np.arange(len(light))[BUNNY_RING]
    return _scaled(Frames(signal, light, normal, mask, some[by_azimuth(light[some])]))


def _scaled(frames: Frames) -> Frames:
    """Scale frames such that the median of the reflectance is MEDIAN_REFLECTANCE, by least squares on the ring's lights."""
    _, reflectance = least_squares(frames.signal[frames.ring], frames.light_direction[frames.ring])
    factor = MEDIAN_REFLECTANCE / np.median(reflectance[frames.mask])
    return replace(frames, signal=frames.signal * factor)


def rim_order(light_direction: np.ndarray) -> np.ndarray:
    """Give the ball's lights on the rim of the array, in order of azimuth from -180 degrees, counter-clockwise.

    The 96 lights hang in 12 columns of 8 and are listed column by column, from the middle to the left end, then
    from the middle to the right end. The rim is the top and bottom row and the two end columns: 36 lights, 26
    to 43 degrees off the axis, with gaps of 7 to 16 degrees in azimuth.
    """
    column, row = np.divmod(np.arange(96), 8)
    rim = np.flatnonzero((row == 0) | (row == 7) | (column == 5) | (column == 11))
    return rim[by_azimuth(light_direction[rim])]


def by_azimuth(light_direction: np.ndarray) -> np.ndarray:
    """Give the order of lights (n,) by azimuth from -180 degrees, counter-clockwise."""
    return np.argsort(np.arctan2(light_direction[:, 1], light_direction[:, 0]))


def least_squares(
    signal: np.ndarray, light_direction: np.ndarray, weight: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Fit signal = reflectance * normal . light per pixel (Woodham 1980).

    Parameters
    ----------
    signal : (n, H, W) float
    light_direction : (n, 3) float
    weight : (n, H, W) bool or float, optional
        How much each frame counts in a pixel; all alike by default.

    Returns
    -------
    normal : (H, W, 3) float64
    reflectance : (H, W) float64
    """
    weight = np.ones_like(signal) if weight is None else weight.astype(float)
    matrix = np.einsum("jyx,ji,jk->yxik", weight, light_direction, light_direction)
    right = np.einsum("jyx,jyx,ji->yxi", weight, signal, light_direction)
    scaled = np.linalg.solve(matrix, right[..., None])[..., 0]
    length = np.linalg.norm(scaled, axis=-1)
    return scaled / np.maximum(length, 1e-9)[..., None], length


OBJECTS: dict[str, tuple[str, Callable[[Path], Frames]]] = {
    "ball": ("diligent_ball_crop.npz", read_ball),
    "matt bunny": ("rps_bunny.npz", lambda path: read_bunny(path, "lambert_noshadow")),
    "shadowed bunny": ("rps_bunny.npz", lambda path: read_bunny(path, "lambert")),
    "glossy bunny": ("rps_bunny.npz", lambda path: read_bunny(path, "specular")),
}
