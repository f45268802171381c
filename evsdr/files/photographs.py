"""Photographs under known lights as the light that event pixels watch.

A stack is an .npz with

`frames` (n_led, H, W) float
    Signal of each photograph: 1 is a white Lambertian patch that faces its light. Row 0 is the top.
`light_direction` (n_led, 3)
    Vectors from surface to light, camera frame (x right, y up, z toward the camera), in the order in which
    they shall be lit.
`normal` (H, W, 3), `reflectance` (H, W, 1), `mask` (H, W), all optional
    What is known to be true.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from evsdr.errors import InputError
from evsdr.files.arrays import read_npz
from evsdr.records import Truth

MAX_LED = 256  # of a scene
UNIT_TOLERANCE = 0.01  # of the length of a normal


@dataclass(frozen=True)
class Stack:
    """Photographs with known lights.

    Attributes
    ----------
    frames : (n_led, H, W) float32
        A_xj, 0 or more.
    light_direction : (n_led, 3) float64
        Unit vectors from surface to light, camera frame.
    truth : Truth
        As far as given: with no normals its mask is empty, an unknown reflectance is 0.
    """

    frames: np.ndarray
    light_direction: np.ndarray
    truth: Truth


def read_stack(path: Path) -> Stack:
    """Read and check a stack.

    Raises
    ------
    InputError
        The file is missing or damaged, or its arrays don't fit each other.
    """
    arrays = _load(path)
    frames, direction = arrays["frames"], arrays["light_direction"].astype(np.float64)
    if frames.dtype.kind != "f":
        raise InputError(
            f"{path}: frames holds {frames.dtype}; divide by the light's intensity, "
            "so that a white patch that faces its light is 1.0."
        )
    for name in ("frames", "light_direction"):
        if not np.isfinite(arrays[name]).all():
            raise InputError(f"{path}: {name} is not finite everywhere; mend these values.")
    if frames.min() < 0:
        raise InputError(f"{path}: frames has negative values; subtract less black level.")
    length = np.linalg.norm(direction, axis=1, keepdims=True)
    if not (length > 0).all():
        raise InputError(f"{path}: light_direction holds a zero vector; give the direction of every light.")
    return Stack(frames.astype(np.float32), direction / length, _truth(path, arrays, frames.shape[1:]))


def _load(path: Path) -> dict[str, np.ndarray]:
    """Read the arrays of a stack; their types and shapes are checked."""
    if not path.is_file():
        raise InputError(f"{path}: there is no such file; name an .npz with frames and light_direction.")
    names = ("frames", "light_direction", "normal", "reflectance", "mask")
    arrays = read_npz(path, names, "write it by numpy.savez")
    for name in names[:2]:
        if name not in arrays:
            raise InputError(f"{path}: the array {name} is missing; store it by numpy.savez.")
    shape = arrays["frames"].shape
    if len(shape) != 3 or 0 in shape or not 2 <= shape[0] <= MAX_LED:
        raise InputError(
            f"{path}: frames has shape {shape}; store 2 to {MAX_LED} photographs as (n_led, height, width)."
        )
    n_led, *size = shape
    shapes = dict(zip(names, (shape, (n_led, 3), (*size, 3), (*size, 1), tuple(size))))
    for name, array in arrays.items():
        if array.dtype.kind not in "fiub" or array.shape != shapes[name]:
            raise InputError(
                f"{path}: {name} is an array of {array.dtype} with shape {array.shape}; "
                f"frames of shape {shape} need numbers with shape {shapes[name]}."
            )
    return arrays


def _truth(path: Path, arrays: dict[str, np.ndarray], size: tuple[int, int]) -> Truth:
    """Give what is known to be true."""
    mask = arrays.get("mask", np.ones(size, bool)) != 0
    reflectance = arrays.get("reflectance", np.zeros((*size, 1), np.float32))
    if "normal" not in arrays:
        facing = np.broadcast_to(np.float32([0, 0, 1]), (*size, 3))
        return Truth(facing, reflectance, np.zeros(size, bool))
    normal = arrays["normal"]
    length = np.linalg.norm(normal[mask], axis=-1)
    if not (np.abs(length - 1) <= UNIT_TOLERANCE).all():
        raise InputError(f"{path}: normal has not unit length at some pixel of the mask; normalise it.")
    return Truth(normal, reflectance, mask)


def write_scene(path: Path, stack: Stack, constant_light: float) -> None:
    """Write the scene.xml of a stack: its lights, far and of one band, before an object of unknown shape.

    A light's spectrum is a triangle of integral 1.
    """
    _, height, width = stack.frames.shape
    lights = "\n".join(
        f"""    <emitter type="directional" id="led_{j:03d}">
        <vector name="direction" value="{-x:.8f}, {-y:.8f}, {-z:.8f}"/>
        <spectrum name="irradiance" value="540:0, 550:0.1, 560:0"/>
    </emitter>"""
        for j, (x, y, z) in enumerate(stack.light_direction)
    )
    path.write_text(
        f"""<scene version="3.0.0">
    <integrator type="ring">
        <float name="constant_light" value="{constant_light:.8g}"/>
    </integrator>
    <sensor type="orthographic" id="camera">
        <transform name="to_world">
            <lookat origin="0, 0, 10" target="0, 0, 0" up="0, 1, 0"/>
        </transform>
        <film type="hdrfilm">
            <integer name="width" value="{width}"/>
            <integer name="height" value="{height}"/>
            <rfilter type="box"/>
        </film>
    </sensor>
    <shape type="rectangle" id="object">
        <transform name="to_world">
            <scale value="10"/>
        </transform>
        <bsdf type="diffuse"/>
    </shape>
{lights}
</scene>
""",
        encoding="utf-8",
    )
