"""A dense workspace of COLMAP: camera and pose, the picture, and its maps of depth and normals.

Layouts are those of https://colmap.github.io/format.html; COLMAP's camera looks along +z, with y down, and pixels are counted
from the corner of the first, as here.
"""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from evsdr.errors import InputError
from evsdr.exports.source import Source
from evsdr.files.daylight import reflectance_to_srgb
from evsdr.files.results import write_png

DOWN_AND_AWAY = np.array([1.0, -1.0, -1.0])  # x, y, z of the camera frame as COLMAP has them
PICTURE = "colour.png"
KINDS = "geometric", "photometric"  # of maps, by which of COLMAP's steps they come; readers ask for either


def write_colmap(folder: Path, source: Source) -> None:
    """Write `images`, `sparse` and `stereo`, as `image_undistorter` and `patch_match_stereo` leave them.

    The world is the scene's. A point of the model is a known pixel: a track of one, as there is one picture.

    Raises
    ------
    InputError
        The camera is orthographic.
    """
    if not source.camera.perspective:
        raise InputError(
            "the scene's camera is orthographic, and COLMAP knows perspective cameras only; take --to gltf or csv."
        )
    mask = source.maps.mask
    for name in ("images", "sparse", "stereo/depth_maps", "stereo/normal_maps"):
        (folder / name).mkdir(parents=True)
    colour = reflectance_to_srgb(source.maps.reflectance, source.maps.band_wavelength_nm)
    colour = np.round(255 * np.clip(colour, 0, 1)).astype(np.uint8)
    write_png(folder / "images" / PICTURE, colour)
    write_model(folder / "sparse", source, colour[mask])
    maps = {
        "depth_maps": -source.points[..., 2],
        "normal_maps": np.where(mask[..., None], source.maps.normal * DOWN_AND_AWAY, 0),
    }
    for name, values in maps.items():
        for kind in KINDS:
            write_array(folder / "stereo" / name / f"{PICTURE}.{kind}.bin", values)
    (folder / "stereo" / "patch-match.cfg").write_text(f"{PICTURE}\n__auto__, 20\n")
    (folder / "stereo" / "fusion.cfg").write_text(f"{PICTURE}\n")


def write_model(folder: Path, source: Source, colour: np.ndarray) -> None:
    """Write `cameras.txt`, `images.txt` and `points3D.txt`; colour (n, 3) uint8 of the known pixels."""
    camera, (height, width) = source.camera, source.maps.mask.shape
    pinhole = (*(1 / size for size in camera.pixel_size), *camera.center)
    (folder / "cameras.txt").write_text(f"1 PINHOLE {width} {height} {_words(pinhole)}\n")
    axes, origin = source.to_world[:3, :3] * DOWN_AND_AWAY, source.to_world[:3, 3]
    turn = np.roll(Rotation.from_matrix(axes.T).as_quat(), 1)  # w first
    row, column = np.nonzero(source.maps.mask)
    seen = " ".join(f"{x + 0.5} {y + 0.5} {k}" for k, (x, y) in enumerate(zip(column, row), 1))
    pose = _words((*turn, *(-axes.T @ origin)))
    (folder / "images.txt").write_text(f"1 {pose} 1 {PICTURE}\n{seen}\n")
    place = source.points[source.maps.mask] @ source.to_world[:3, :3].T + origin
    lines = (
        f"{k + 1} {_words(xyz)} {r} {g} {b} 0 1 {k}\n"
        for k, (xyz, (r, g, b)) in enumerate(zip(place, colour))
    )
    (folder / "points3D.txt").write_text("".join(lines))


def write_array(path: Path, values: np.ndarray) -> None:
    """Write an image (H, W) or (H, W, channels) as COLMAP does: its size in text, then channel after channel, float32."""
    values = np.atleast_3d(values)
    height, width, channels = values.shape
    head = f"{width}&{height}&{channels}&".encode()
    path.write_bytes(head + np.moveaxis(values, 2, 0).astype("<f4").tobytes())


def _words(numbers) -> str:
    return " ".join(f"{number:.12g}" for number in numbers)
