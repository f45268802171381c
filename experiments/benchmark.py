"""Time the one-pass renderer and check its gradients.

    python -m experiments.benchmark ring        # against one stock render per LED
    python -m experiments.benchmark gradients   # against central finite differences
"""

import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np
import trimesh
import tyro
from rich.console import Console
from rich.progress import track
from rich.table import Table

from evsdr import jit

PEAK_NM = (405, 430, 460, 490, 525, 560, 595, 635)


# ---------------------------------------------------------------------- scenes


def led_spectrum(peak_nm: float, width_nm: float = 8.0) -> dict:
    """Give an LED of unit irradiance: a Gaussian peak of standard deviation `width_nm`."""
    nm = np.arange(peak_nm - 4 * width_nm, peak_nm + 4.1 * width_nm, width_nm / 2)
    density = np.exp(-0.5 * ((nm - peak_nm) / width_nm) ** 2)
    density /= np.trapezoid(density, nm)
    return {"type": "spectrum", "value": list(zip(nm.tolist(), density.tolist()))}


def ring_directions(n_led: int) -> np.ndarray:
    """Give unit vectors from the origin to the LEDs (n_led, 3): polar angle 45 degrees, even azimuths."""
    azimuth = 2 * np.pi * np.arange(n_led) / n_led
    return np.stack([np.cos(azimuth), np.sin(azimuth), np.ones(n_led)], axis=1) / np.sqrt(2)


def far_ring(n_led: int = 24) -> dict:
    """Describe far LEDs, LED j of band j mod 8."""
    return {
        f"led_{j:02d}": {
            "type": "directional",
            "direction": (-d).tolist(),
            "irradiance": led_spectrum(PEAK_NM[j % len(PEAK_NM)]),
        }
        for j, d in enumerate(ring_directions(n_led))
    }


def camera(size: int) -> dict:
    """Describe an orthographic camera along -z that sees |x|, |y| < 1.2."""
    transform = mi.ScalarTransform4f
    return {
        "type": "orthographic",
        "to_world": transform().look_at([0, 0, 10], [0, 0, 0], [0, 1, 0]) @ transform().scale([1.2, 1.2, 1]),
        "film": {"type": "hdrfilm", "width": size, "height": size, "rfilter": {"type": "box"}},
    }


def surface() -> dict:
    """Describe a diffuse surface whose reflectance varies smoothly with the wavelength."""
    return {
        "type": "diffuse",
        "reflectance": {"type": "spectrum", "value": [(360, 0.2), (550, 0.5), (650, 0.8), (830, 0.6)]},
    }


def blob() -> mi.Shape:
    """Make a bumpy ball of 10,000 triangles that casts shadows on itself."""
    rng = np.random.default_rng(1)
    mesh = trimesh.creation.uv_sphere(count=(36, 72))
    wave, phase = rng.normal(0, 3, (12, 3)), rng.uniform(0, 2 * np.pi, 12)
    bump = np.cos(mesh.vertices @ wave.T + phase).sum(axis=1)
    mesh.vertices *= (1 + 0.03 * bump)[:, None]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "blob.ply"
        mesh.export(path, vertex_normal=True)
        return mi.load_dict({"type": "ply", "filename": str(path), "bsdf": surface()})


# ---------------------------------------------------------------------- ring: time


def ring(size: int = 256, n_led: int = 24, repetitions: int = 9) -> None:
    """Time one pass of `ring` against one stock render per LED, each of a scene with that LED alone.

    Both take turns, after a warm-up of each. The LEDs are far, so the stock integrator gets by with
    `bsdf_samples` 0, its fastest setting; its default of 1 is shown, too.
    """
    shape = blob()
    leds = far_ring(n_led)
    whole = mi.load_dict({"type": "scene", "camera": camera(size), "object": shape} | leds)
    single = [
        mi.load_dict({"type": "scene", "camera": camera(size), "object": shape, name: led})
        for name, led in leds.items()
    ]
    direct = {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0}
    path = {"type": "path", "max_depth": 3, "rr_depth": 100}
    case = [  # title, samples per pixel, max_depth of ring, stock integrator
        ("direct, bsdf_samples 0", 1, 1, direct),
        ("direct, bsdf_samples 0", 16, 1, direct),
        ("direct, default", 1, 1, {"type": "direct"}),
        ("direct, default", 16, 1, {"type": "direct"}),
        ("path, max_depth 3", 1, 2, path),
        ("path, max_depth 3", 16, 2, path),
    ]
    table = Table(title=f"{n_led} LEDs, {size} x {size} pixels, {shape.face_count():,} triangles: minimum / median [ms]")
    for title in ("rays per pixel", "max_depth", "ring, one pass", f"{n_led} stock renders", "stock integrator", "times faster"):
        table.add_column(title, justify="right")
    for title, spp, max_depth, stock in track(case, "ring", transient=True):
        one_pass, reference = mi.load_dict({"type": "ring", "max_depth": max_depth}), mi.load_dict(stock)

        def render_ring(seed):
            dr.eval(one_pass.render(whole, seed=seed, spp=spp))

        def render_stock(seed):
            for scene in single:
                dr.eval(reference.render(scene, seed=seed, spp=spp))

        a, b = alternate(render_ring, render_stock, repetitions)
        table.add_row(str(spp), str(max_depth), spread(a), spread(b), title, f"{b.min() / a.min():.1f} / {np.median(b) / np.median(a):.1f}")
    Console().print(table)


def alternate(first, second, repetitions: int) -> tuple[np.ndarray, np.ndarray]:
    """Time two callables of a seed in turns, after a warm-up.

    Returns
    -------
    first_ms, second_ms : (repetitions,) float
        Wall-clock times [ms].
    """
    ms = np.empty((2, repetitions))
    for work in (first, second):
        work(0)
    for k in range(repetitions):
        for i, work in enumerate((first, second)):
            dr.sync_thread()
            start = time.perf_counter()
            work(k + 1)
            dr.sync_thread()
            ms[i, k] = 1e3 * (time.perf_counter() - start)
    return ms[0], ms[1]


def spread(ms: np.ndarray) -> str:
    return f"{ms.min():.0f} / {np.median(ms):.0f}"


# ---------------------------------------------------------------------- gradients: finite differences


@dataclass(frozen=True)
class GradientCheck:
    """One gradient by automatic differentiation and by central finite differences.

    Attributes
    ----------
    parameter, route : str
        What the loss is differentiated by, and the function that did it.
    automatic, finite : (n_value,) float
        Both gradients.
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
        """Give the largest difference of a value over the largest value."""
        return float(np.abs(self.automatic - self.finite).max() / np.abs(self.finite).max())


def check_gradients(size: int = 32, step: float = 5e-3) -> list[GradientCheck]:
    """Differentiate sum_x (log I_xa - log I_xb)^2 of a far and a near LED of different bands.

    A pixel's loss depends on its own normal and reflectance alone, so two renders give the finite
    difference of all pixels by one of their values. Left out are the pixels where a step crosses the kink
    of max(0, n . l).

    Parameters
    ----------
    size : int
        Image width and height [pixels].
    step : float
        Half the distance of the central differences.
    """
    scene, integrator, value = gradient_scene(size)
    params = mi.traverse(integrator)

    def assign(value):
        for key, array in value.items():
            params[key] = mi.TensorXf(array.astype(np.float32)) if array.ndim else mi.Float(float(array))
        params.update()

    def image():
        return np.array(integrator.render(scene, seed=3, spp=1), dtype=float)

    def loss(array):  # (H, W), double precision
        return np.log(array[..., 0] / array[..., 1]) ** 2

    assign(value)
    far_from_kink = gradient_mask(integrator, scene, value["normal"], 4 * step)
    finite = {}
    for key, array in value.items():
        by = np.zeros(array.shape)
        for channel in np.ndindex(array.shape[2:]):
            side = []
            for sign in (1, -1):
                moved = array.copy()
                moved[(..., *channel)] += sign * step
                assign(value | {key: moved})
                side.append(loss(image()))
            difference = (side[0] - side[1]) / (2 * step)
            by[(..., *channel)] = difference if array.ndim else difference.sum()
        finite[key] = by
    assign(value)

    def by_render():
        now = integrator.render(scene, seed=3, spp=1)
        dr.backward(dr.sum(dr.square(dr.log(now[..., 0] / now[..., 1]))))

    def by_render_backward():
        now = image()
        ratio = np.log(now[..., 0] / now[..., 1])
        grad_in = 2 * ratio[..., None] / now * np.array([1, -1])
        integrator.render_backward(scene, params, mi.TensorXf(grad_in.astype(np.float32)), seed=3, spp=1)

    checks = []
    for route, differentiate in (("render, dr.backward", by_render), ("render_backward", by_render_backward)):
        for key in value:
            dr.enable_grad(params[key])
            params.set_dirty(key)
        params.update()
        differentiate()
        for key, by in finite.items():
            kept = far_from_kink if key == "normal" else np.ones_like(far_from_kink)
            kept = kept if by.ndim else ...
            automatic = np.array(dr.grad(params[key]), dtype=float).reshape(by.shape)
            checks.append(GradientCheck(key, route, automatic[kept].ravel(), by[kept].ravel()))
        assign(value)
    return checks


def gradient_scene(size: int):
    """Make a sphere with a pole that shades it, a far and a near LED, and normals and reflectance near the truth.

    Returns
    -------
    scene : mi.Scene
    integrator : the scene's `ring`
    value : dict of normal (H, W, 3), reflectance (H, W, 2) and constant_light ()
    """
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "ring", "constant_light": 0.05},
            "camera": camera(size),
            "led_0": {"type": "directional", "direction": [-1, 0, -1], "irradiance": led_spectrum(460)},
            "led_1": {
                "type": "point",
                "position": [-1, 2, 2],
                "intensity": {"type": "spectrum", "value": [(560, 0), (590, 0.3), (620, 0)]},
            },
            "object": {"type": "sphere", "bsdf": surface()},
            "pole": {"type": "cylinder", "p0": [0.8, 0.3, 0.5], "p1": [0.4, 0.2, 1.6], "radius": 0.15},
        }
    )
    rng = np.random.default_rng(7)
    centre = 1.2 * ((np.arange(size) + 0.5) / size * 2 - 1)
    x, y = np.meshgrid(centre, -centre)
    normal = np.stack([x, y, np.sqrt(np.maximum(1 - x**2 - y**2, 0.04))], axis=-1)
    value = {
        "normal": normal * rng.uniform(0.7, 1.4, (size, size, 1)) + rng.normal(0, 0.05, normal.shape),
        "reflectance": rng.uniform(0.2, 0.9, (size, size, 2)),
        "constant_light": np.array(0.05),
    }
    return scene, scene.integrator(), value


def gradient_mask(integrator, scene, normal: np.ndarray, margin: float) -> np.ndarray:
    """Find the pixels (H, W) where no |n . l| is below the margin."""
    illumination, _ = integrator.illumination(scene, scene.sensors()[0], 1)
    unit = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
    kept = np.ones(normal.shape[:2], bool)
    for direction in illumination.direction:
        light = np.array(direction, dtype=float).T.reshape(-1, 3)
        light = np.broadcast_to(light, (normal.shape[0] * normal.shape[1], 3)).reshape(normal.shape)
        kept &= np.abs(np.sum(unit * light, axis=-1)) > margin
    return kept


def gradients(size: int = 32, step: float = 5e-3) -> None:
    """Print gradients of a log-ratio loss by automatic differentiation and by finite differences."""
    table = Table(title="sum (log I_a - log I_b)^2: automatic (AD) against central finite differences (FD)")
    for title in ("by", "through", "values", "|AD|", "|FD|", "|AD - FD| / |FD|", "largest / largest"):
        table.add_column(title, justify="left" if title in ("by", "through") else "right")
    for check in check_gradients(size, step):
        norm = [f"{np.linalg.norm(g):.6g}" for g in (check.automatic, check.finite)]
        error = [f"{check.relative_error:.1e}", f"{check.largest_error:.1e}"]
        table.add_row(check.parameter, check.route, str(len(check.finite)), *norm, *error)
    Console().print(table)


COMMANDS = {"ring": ring, "gradients": gradients}


def main(args: list[str] | None = None) -> None:
    """Run one of the benchmarks."""
    jit.start()
    tyro.extras.subcommand_cli_from_dict(COMMANDS, prog="benchmark", description=__doc__, args=args)


if __name__ == "__main__":
    main()
