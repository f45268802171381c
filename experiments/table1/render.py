"""Frames by stock Mitsuba: the `path` integrator at depth 3, one render per light; nothing of ours but the start.

Bands are single wavelengths: reflectances are textures without colour, one scene per band. Hence there is no
noise of sampled wavelengths, and the rank of the reflectance is exactly that of its bases.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np

from .cases import HALF_WIDTH, Case, led_directions

DEPTH = 3  # of a path as Mitsuba counts: light, and light by way of one other surface
SPP = 64  # rays per pixel
TRUTH_GRID = 8  # rays per pixel and axis
LIT = 0.01  # of a white patch: what the brightest LED gives a pixel at least
FILM_NM = 500.0, 550.0  # where the film measures; nothing depends on wavelength


@dataclass(frozen=True)
class Frames:
    """What a camera would see, in units of a white patch that faces the light.

    Attributes
    ----------
    ring : (n_led, H, W) float32
        Each LED of the ring alone.
    white : (n_led, H, W) float32
        The same with white LEDs; none for a rainbow.
    frontal : (n_band, H, W) float32
        Light of each band along the camera's axis.
    normal, reflectance, mask
        What is true, see `Truth`.
    """

    ring: np.ndarray
    white: np.ndarray
    frontal: np.ndarray
    normal: np.ndarray
    reflectance: np.ndarray
    mask: np.ndarray


def render(case: Case, mesh: Path, reflectance: np.ndarray, size: int, spp: int = SPP) -> Frames:
    """Render all frames of a case.

    Parameters
    ----------
    mesh : Path
        Its PLY file.
    reflectance : (texels, texels, n_band) float
        Its texture.
    size : int
        Width and height [pixels].
    spp : int
        Rays per pixel.
    """
    leds, front = led_directions(case.polar_deg, case.n_led), np.array([[0.0, 0.0, 1.0]])
    ring, frontal = np.empty((case.n_led, size, size), np.float32), []
    for b in range(len(case.band_nm)):
        own = np.arange(case.n_led) % len(case.band_nm) == b
        images = shots(case, mesh, reflectance[..., b], np.concatenate([leds[own], front]), size, spp)
        ring[own] = images[:-1]
        frontal.append(images[-1])
    white = shots(case, mesh, reflectance.mean(axis=-1), [] if case.is_rainbow else leds, size, spp)
    normal, true, covered = truth(mesh, reflectance, size)
    mask = covered & (ring.max(axis=0) > LIT)
    return Frames(ring, white, np.stack(frontal), normal, true, mask)


def shots(
    case: Case, mesh: Path, grey: np.ndarray, directions: Sequence[np.ndarray], size: int, spp: int
) -> np.ndarray:
    """Render one image (n, H, W) for each direction to a far light; all have the same rays."""
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": DEPTH, "rr_depth": 100},
            "camera": camera(size, spp),
            "object": {"type": "ply", "filename": str(mesh), "bsdf": surface(grey, case)},
            "led": {"type": "directional", "irradiance": {"type": "uniform", "value": 1.0}},
        }
    )
    parameters, images = mi.traverse(scene), []
    for direction in directions:
        parameters["led.to_world"] = mi.Transform4f(
            mi.ScalarTransform4f().look_at([0, 0, 0], (-direction).tolist(), up(direction))
        )
        parameters.update()
        images.append(np.array(mi.render(scene, seed=0))[..., 0])
    return np.pi / (FILM_NM[1] - FILM_NM[0]) * np.array(images, np.float32).reshape(-1, size, size)


def up(direction: np.ndarray) -> list[float]:
    """Give an axis that is not parallel to a direction."""
    return [0, 1, 0] if abs(direction[1]) < 0.7 else [1, 0, 0]


def camera(size: int, spp: int) -> dict:
    """Describe an orthographic camera along -z."""
    look = mi.ScalarTransform4f().look_at([0, 0, 10], [0, 0, 0], [0, 1, 0])
    band = {"type": "spectrum", "value": [(nm, 1.0) for nm in np.linspace(*FILM_NM, 3).tolist()]}
    film = {"type": "specfilm", "width": size, "height": size, "rfilter": {"type": "box"}, "band": band}
    return {
        "type": "orthographic",
        "to_world": mi.ScalarTransform4f().scale([HALF_WIDTH, HALF_WIDTH, 1]) @ look,
        "film": film,
        "sampler": {"type": "multijitter", "sample_count": spp},
    }


def surface(grey: np.ndarray, case: Case) -> dict:
    """Describe a Lambertian surface of that reflectance with a glossy lobe added."""
    diffuse = {"type": "diffuse", "reflectance": image(grey / (1 - case.gloss))}
    lobe = {"type": "roughconductor", "material": "none", "distribution": "ggx", "alpha": case.roughness}
    blend = {"type": "blendbsdf", "weight": case.gloss, "first": diffuse, "second": lobe}
    return {"type": "twosided", "blend": blend}


def image(grey: np.ndarray) -> dict:
    """Describe a texture without colour, linear between texels."""
    bitmap = mi.Bitmap(np.ascontiguousarray(grey[..., None], np.float32))
    return {"type": "bitmap", "bitmap": bitmap, "raw": True, "wrap_mode": "clamp"}


def truth(mesh: Path, reflectance: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Give normals, reflectances and whether the object covers the pixel whole, means over a grid of rays."""
    shape = mi.load_dict({"type": "ply", "filename": str(mesh)})
    scene = mi.load_dict({"type": "scene", "camera": camera(size, 1), "object": shape})
    n = size * TRUTH_GRID
    at = (np.stack(np.meshgrid(np.arange(n), np.arange(n)), axis=-1).reshape(-1, 2) + 0.5) / n
    ray, _ = scene.sensors()[0].sample_ray(0.0, 0.5, mi.Point2f(at.T.astype(np.float32)), mi.Point2f(0.5))
    si = scene.ray_intersect(ray)

    def mean(values):
        return np.array(values).reshape(size, TRUTH_GRID, size, TRUTH_GRID).mean(axis=(1, 3))

    covered = mean(si.is_valid()) == 1
    facing = dr.select(si.wi.z < 0, mi.Float(-1.0), mi.Float(1.0))
    normal = np.stack([mean(facing * part) for part in si.sh_frame.n], axis=-1)
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    normal = np.where(covered[..., None] & (length > 0), normal / np.maximum(length, 1e-12), [0, 0, 1])
    textures = [mi.load_dict(image(reflectance[..., b])) for b in range(reflectance.shape[-1])]
    bands = np.stack([mean(texture.eval_1(si)) for texture in textures], axis=-1)
    return normal.astype(np.float32), bands.astype(np.float32), covered
