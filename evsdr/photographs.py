"""Photographs under known lights as the light that event pixels watch.

A stack is an .npz with

`frames` (n_led, H, W) float
    Signal of each photograph: 1 is a white Lambertian patch that faces its light.
`light_direction` (n_led, 3) float
    Unit vectors from surface to light, camera frame (x right, y up, z toward the camera), in the order in
    which they shall be lit.
`normal` (H, W, 3), `reflectance` (H, W, 1), `mask` (H, W), all optional
    What is known to be true.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from evsdr.errors import InputError
from evsdr.metrics import Truth


@dataclass(frozen=True)
class Stack:
    """Photographs with known lights.

    Attributes
    ----------
    frames : (n_led, H, W) float32
    light_direction : (n_led, 3) float
    truth : Truth
        As far as given; an unknown normal is frontal, an unknown reflectance 0.
    """

    frames: np.ndarray
    light_direction: np.ndarray
    truth: Truth


def read_stack(path: Path) -> Stack:
    """Read and check a stack.

    Raises
    ------
    InputError
        The file is missing or its arrays don't fit each other.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file; name an .npz with frames and light_direction.")
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
    except (OSError, ValueError, EOFError) as error:
        raise InputError(f"{path}: not a readable .npz archive; write it by numpy.savez.") from error
    for name, n_dimension in (("frames", 3), ("light_direction", 2)):
        if name not in arrays or arrays[name].ndim != n_dimension or not np.isfinite(arrays[name]).all():
            raise InputError(
                f"{path}: {name} is missing or not a finite array of {n_dimension} dimensions; store it."
            )
    frames, direction = arrays["frames"].astype(np.float32), arrays["light_direction"].astype(float)
    n_led, *shape = frames.shape
    if direction.shape != (n_led, 3) or n_led < 2:
        raise InputError(
            f"{path}: light_direction has shape {direction.shape}; {n_led} frames need ({n_led}, 3)."
        )
    if frames.min() < 0:
        raise InputError(f"{path}: frames has negative values; subtract less black level.")
    length = np.linalg.norm(direction, axis=1, keepdims=True)
    if not (length > 0).all():
        raise InputError(f"{path}: light_direction holds a zero vector; give the direction of every light.")
    truth = Truth(
        normal=arrays.get("normal", np.broadcast_to(np.float32([0, 0, 1]), (*shape, 3))),
        reflectance=arrays.get("reflectance", np.zeros((*shape, 1), np.float32)),
        mask=arrays.get("mask", np.ones(shape, bool)) != 0,
    )
    if [a.shape[:2] for a in (truth.normal, truth.reflectance, truth.mask)] != [tuple(shape)] * 3:
        raise InputError(
            f"{path}: normal, reflectance and mask must be as large as the frames, {shape[0]} x {shape[1]}."
        )
    return Stack(frames, direction / length, truth)


def write_scene(path: Path, stack: Stack, constant_light: float) -> None:
    """Write the scene.xml of a stack: its lights, far and of one band, before an object of unknown shape."""
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
