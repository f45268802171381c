"""How much faster one pass of `ring` is than one stock render per LED."""

import tempfile
import time
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np
import trimesh
from rich.console import Console
from rich.progress import track
from rich.table import Table

PEAK_NM = (405, 430, 460, 490, 525, 560, 595, 635)

LIGHTS_ONLY = {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0}
PATH = {"type": "path", "max_depth": 3, "rr_depth": 100}
CASES = (  # samples per pixel, max_depth of ring, stock integrator, its name
    (1, 1, LIGHTS_ONLY, "direct, bsdf_samples=0"),
    (16, 1, LIGHTS_ONLY, "direct, bsdf_samples=0"),
    (1, 1, {"type": "direct"}, "direct"),
    (16, 1, {"type": "direct"}, "direct"),
    (1, 2, PATH, "path, max_depth=3"),
    (16, 2, PATH, "path, max_depth=3"),
)


def report(size: int = 256, n_led: int = 24, repetitions: int = 9) -> None:
    """Time one pass of the ring integrator against a stock render per LED, each of a scene with it alone.

    Both take turns after a warm-up. No ray that leaves a surface at random can hit a far LED, so
    bsdf_samples=0 is the fastest that stock `direct` can be; its default is shown, too.
    """
    shape, leds = blob(), far_ring(n_led)
    whole = mi.load_dict({"type": "scene", "camera": camera(size), "object": shape} | leds)
    single = [
        mi.load_dict({"type": "scene", "camera": camera(size), "object": shape, name: led})
        for name, led in leds.items()
    ]
    title = f"{n_led} LEDs, {size} x {size} pixels, {shape.face_count():,} triangles; minimum / median"
    table = Table(title=title, box=None)
    for heading in ("spp", "depth", "one pass, ms", f"{n_led} renders, ms", "faster"):
        table.add_column(heading, justify="right")
    table.add_column("stock integrator")
    for spp, max_depth, stock, name in track(CASES, "ring", transient=True):
        one_pass, reference = mi.load_dict({"type": "ring", "max_depth": max_depth}), mi.load_dict(stock)

        def render_ring(seed):
            dr.eval(one_pass.render(whole, seed=seed, spp=spp))

        def render_stock(seed):
            for scene in single:
                dr.eval(reference.render(scene, seed=seed, spp=spp))

        ours, theirs = alternate(render_ring, render_stock, repetitions)
        ratio = f"{theirs.min() / ours.min():.1f} / {np.median(theirs) / np.median(ours):.1f}"
        table.add_row(str(spp), str(max_depth), spread(ours), spread(theirs), ratio, name)
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
    """Write minimum and median."""
    return f"{ms.min():.0f} / {np.median(ms):.0f}"


# ---------------------------------------------------------------------- scene


def led_spectrum(peak_nm: float, width_nm: float = 8.0) -> dict:
    """Describe an LED of unit irradiance: a Gaussian peak of standard deviation `width_nm`."""
    nm = np.arange(peak_nm - 4 * width_nm, peak_nm + 4.1 * width_nm, width_nm / 2)
    density = np.exp(-0.5 * ((nm - peak_nm) / width_nm) ** 2)
    density /= np.trapezoid(density, nm)
    return {"type": "spectrum", "value": list(zip(nm.tolist(), density.tolist()))}


def far_ring(n_led: int) -> dict:
    """Describe far LEDs at a polar angle of 45 degrees and even azimuths, LED j of band j mod 8."""
    azimuth = 2 * np.pi * np.arange(n_led) / n_led
    return {
        f"led_{j:02d}": {
            "type": "directional",
            "direction": [-np.cos(a), -np.sin(a), -1.0],
            "irradiance": led_spectrum(PEAK_NM[j % len(PEAK_NM)]),
        }
        for j, a in enumerate(azimuth.tolist())
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
    samples = [(360, 0.2), (550, 0.5), (650, 0.8), (830, 0.6)]
    return {"type": "diffuse", "reflectance": {"type": "spectrum", "value": samples}}


def blob() -> mi.Shape:
    """Make a bumpy ball of about 10,000 triangles that shades itself."""
    rng = np.random.default_rng(1)
    mesh = trimesh.creation.uv_sphere(count=(36, 72))
    wave, phase = rng.normal(0, 3, (12, 3)), rng.uniform(0, 2 * np.pi, 12)
    mesh.vertices *= 1 + 0.03 * np.cos(mesh.vertices @ wave.T + phase).sum(axis=1, keepdims=True)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "blob.ply"
        mesh.export(path, vertex_normal=True)
        return mi.load_dict({"type": "ply", "filename": str(path), "bsdf": surface()})
