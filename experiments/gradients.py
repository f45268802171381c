"""Gradients of the `ring` integrator by automatic differentiation and by central finite differences."""

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np
from rich.console import Console
from rich.table import Table

from .one_pass import camera, led_spectrum, surface


@dataclass(frozen=True)
class GradientCheck:
    """One gradient, computed twice.

    Attributes
    ----------
    parameter, route : str
        What the loss is differentiated by, and by which function of Mitsuba.
    automatic, finite : (n_value,) float
        By automatic differentiation, and by finite differences.
    """

    parameter: str
    route: str
    automatic: np.ndarray
    finite: np.ndarray

    @property
    def relative_error(self) -> float:
        """Give |automatic - finite| / |finite|, Euclidean norms."""
        return float(np.linalg.norm(self.automatic - self.finite) / np.linalg.norm(self.finite))

    @property
    def largest_error(self) -> float:
        """Give the largest difference of a value, relative to the largest value."""
        return float(np.abs(self.automatic - self.finite).max() / np.abs(self.finite).max())


def report(size: int = 32, step: float = 1e-3) -> None:
    """Compare gradients of a log-ratio loss with central finite differences."""
    title = "sum over pixels of (log I_a - log I_b)^2: derivatives"
    table = Table("by", "through", title=title, box=None)
    for heading in ("values", "|AD|", "|FD|", "|AD-FD|/|FD|", "largest"):
        table.add_column(heading, justify="right")
    for check in compare(size, step):
        norms = [f"{np.linalg.norm(g):.5g}" for g in (check.automatic, check.finite)]
        errors = [f"{check.relative_error:.1e}", f"{check.largest_error:.1e}"]
        table.add_row(check.parameter, check.route, str(len(check.finite)), *norms, *errors)
    Console().print(table)


def compare(size: int = 32, step: float = 1e-3) -> list[GradientCheck]:
    """Differentiate sum_x (log I_xa - log I_xb)^2 for a far LED a and a near LED b of another band.

    Parameters
    ----------
    size : int
        Image width and height [pixels].
    step : float
        Half the distance of the central differences, relative to the largest value of a parameter.

    Returns
    -------
    list of GradientCheck
        For normal, reflectance and constant light, each through `render` with `dr.backward` and through
        `render_backward`. Normals within four steps of the kink of max(0, n . l) are left out.
    """
    scene = make_scene(size)
    value = start_values(size)
    finite = finite_differences(scene, value, step)
    smooth = away_from_kink(scene, value["normal"], 4 * step)
    checks = []
    for route, differentiate in (("dr.backward", by_render), ("render_backward", by_render_backward)):
        params = assign(scene, value)
        for key in value:
            dr.enable_grad(params[key])
            params.set_dirty(key)
        params.update()
        differentiate(scene, params)
        for key, by in finite.items():
            automatic = np.array(dr.grad(params[key]), dtype=float).reshape(by.shape)
            kept = smooth if key == "normal" else ...
            checks.append(GradientCheck(key, route, automatic[kept].ravel(), by[kept].ravel()))
    return checks


def by_render(scene, params) -> None:
    """Leave the gradient of the loss in the parameters: through the image."""
    image = scene.integrator().render(scene, spp=1)
    dr.backward(dr.sum(dr.square(dr.log(image[..., 0] / image[..., 1]))))


def by_render_backward(scene, params) -> None:
    """Leave the gradient of the loss in the parameters: the integrator is given the loss's by the image."""
    image = render(scene)
    log_ratio = np.log(image[..., :1] / image[..., 1:])
    by_image = 2 * log_ratio / image * np.array([1.0, -1.0])
    scene.integrator().render_backward(scene, params, mi.TensorXf(by_image.astype(np.float32)), spp=1)


def finite_differences(scene, value: dict, step: float) -> dict:
    """Differentiate the loss by central differences.

    A pixel's loss depends on no other pixel's normal or reflectance, so all pixels take a step at once.
    """
    finite = {}
    for key, array in value.items():
        h = step * np.abs(array).max()
        by = np.empty(array.shape)
        for channel in np.ndindex(array.shape[2:]):
            loss = []
            for sign in (1, -1):
                moved = array.copy()
                moved[(..., *channel)] += sign * h
                assign(scene, value | {key: moved})
                image = render(scene)
                loss.append(np.log(image[..., 0] / image[..., 1]) ** 2)
            difference = (loss[0] - loss[1]) / (2 * h)
            by[(..., *channel)] = difference if array.ndim else difference.sum()
        finite[key] = by
    return finite


def away_from_kink(scene, normal: np.ndarray, margin: float) -> np.ndarray:
    """Find the pixels (H, W) where |n . l| of both LEDs exceeds the margin."""
    illumination, _ = scene.integrator().illumination(scene, scene.sensors()[0], 1)
    unit = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
    smooth = np.ones(normal.shape[:2], bool)
    for direction in illumination.direction:
        light = np.array(direction, dtype=float).T  # (1 or n_pixel, 3)
        cosine = np.sum(unit.reshape(-1, 3) * light, axis=-1)
        smooth &= np.abs(cosine).reshape(smooth.shape) > margin
    return smooth


# ---------------------------------------------------------------------- scene


def make_scene(size: int) -> mi.Scene:
    """Make a sphere shaded by a pole, with a far and a near LED."""
    near = {"type": "spectrum", "value": [(560, 0.0), (590, 0.3), (620, 0.0)]}
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "ring"},
            "camera": camera(size),
            "led_0": {"type": "directional", "direction": [-1, 0, -1], "irradiance": led_spectrum(460)},
            "led_1": {"type": "point", "position": [-1, 2, 2], "intensity": near},
            "object": {"type": "sphere", "bsdf": surface()},
            "pole": {"type": "cylinder", "p0": [0.8, 0.3, 0.5], "p1": [0.4, 0.2, 1.6], "radius": 0.15},
        }
    )


def start_values(size: int) -> dict:
    """Draw normals (H, W, 3) of any length around a sphere's, reflectance (H, W, 2) and constant light ()."""
    rng = np.random.default_rng(7)
    centre = 1.2 * ((np.arange(size) + 0.5) / size * 2 - 1)
    x, y = np.meshgrid(centre, -centre)
    normal = np.stack([x, y, np.sqrt(np.maximum(1 - x**2 - y**2, 0.04))], axis=-1)
    return {
        "normal": normal * rng.uniform(0.7, 1.4, (size, size, 1)) + rng.normal(0, 0.05, normal.shape),
        "reflectance": rng.uniform(0.2, 0.9, (size, size, 2)),
        "constant_light": np.array(0.05),
    }


def assign(scene, value: dict):
    """Set the integrator's parameters; give them back as Mitsuba names them."""
    params = mi.traverse(scene.integrator())
    for key, array in value.items():
        params[key] = mi.TensorXf(array.astype(np.float32)) if array.ndim else mi.Float(float(array))
    params.update()
    return params


def render(scene) -> np.ndarray:
    """Render the image (H, W, 2) in double precision."""
    return np.array(scene.integrator().render(scene, spp=1), dtype=float)
