"""`python -m experiments.near_leds`: near LEDs over unknown shapes, whose distance is told, inferred, told true."""

import argparse
import warnings

import numpy as np

import evsdr

from .cast_shadow.compute import MESHES, data_folder
from .draws.cases import open_text, scaled_mesh

SHAPES = ("sphere", "blob", "relief", "goathead", "skull")
SURFACE = '<include filename="bases_3.xml"/>'
TOLD = evsdr.Settings(shared=tuple(name for name in evsdr.Settings().shared if name != "distance"))
COLUMNS = "shape | way | nearer: found, true | mean deg | R / true | % within 1 2 3: normals | R"
REACH = 1.2  # half width of the rectangle


def main() -> None:
    """Record each shape by an EVK4 that tells one value for all thresholds; fit it in four ways, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("shape", nargs="*", help=f"of {', '.join(SHAPES)}; all by default")
    parser.add_argument("--size", type=int, default=48, help="width and height [pixels]")
    parser.add_argument("--seed", type=int, default=0, help="of the recording")
    options = parser.parse_args()
    print(f"| {COLUMNS} |\n|{'---|' * 7}")
    for name in options.shape or SHAPES:
        if name not in MESHES or (data_folder() / MESHES[name]).is_file():
            report(name, options.size, options.seed)


def report(name: str, size: int, seed: int) -> None:
    """Print the rows of a shape."""
    ring = open_text(text(solid(name)), size)
    recording, truth = evsdr.simulate(ring, seed=seed, thresholds="nominal")
    height = mean_height(ring, truth)
    for way, shape, settings in (
        ("as told", plane(0.0), TOLD),
        ("inferred", plane(0.0), evsdr.Settings()),
        ("told true", plane(height), TOLD),
        ("shape known", solid(name), evsdr.Settings()),
    ):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", evsdr.InputWarning)
            fit = evsdr.fit(open_text(text(shape), size), recording, settings, truth.mask)
        found = fit.decisions["distance of the surface"].found
        told = f"{found['nearer']:.3f} +- {found['nearer_sigma']:.3f}, {height:.3f}" if found else ""
        print(f"| {name} | {way} | {told} | {figures(fit.maps, truth)} |", flush=True)


def figures(maps: evsdr.Maps, truth: evsdr.Truth) -> str:
    """Give errors of the known pixels, beside their sigmas."""
    known = maps.mask & truth.mask
    angle = evsdr.angular_error_deg(maps.normal, truth.normal)[known]
    off = np.abs(maps.reflectance - truth.reflectance)[known] / maps.reflectance_sigma[known]
    shares = (
        " ".join(f"{100 * np.mean(z <= level):.0f}" for level in (1, 2, 3))
        for z in (angle / maps.normal_sigma_deg[known], off)
    )
    ratio = np.median(maps.reflectance[known] / truth.reflectance[known])
    return " | ".join([f"{angle.mean():.2f}", f"{ratio:.3f}", *shares])


def mean_height(ring, truth: evsdr.Truth) -> float:
    """Give how far in front of the origin the surface is on average."""
    from evsdr.light.ground_truth import object_depth  # which needs the backend

    return 10.0 - float(object_depth(ring)[truth.mask].mean())  # the camera of scenes/camera.xml stands at 10


def solid(name: str) -> str:
    """Write a shape."""
    if name == "sphere":
        return '<shape type="sphere" id="object"><ref id="surface"/></shape>'
    file = scaled_mesh(name) if name in MESHES else f"{name}.ply"
    return (
        f'<shape type="ply" id="object"><string name="filename" value="{file}"/><ref id="surface"/></shape>'
    )


def plane(height: float) -> str:
    """Write a rectangle that stands for it."""
    place = f'<scale value="{REACH}"/><translate z="{height}"/>'
    return f'<shape type="rectangle" id="object"><transform name="to_world">{place}</transform></shape>'


def text(shape: str) -> str:
    """Write the scene: the ring of 24 near LEDs, 3.5 from the origin."""
    parts = '<include filename="camera.xml"/><include filename="ring24_near.xml"/>'
    veil = '<integrator type="ring"><float name="constant_light" value="0.05"/></integrator>'
    surface = SURFACE if "surface" in shape else ""
    defaults = '<default name="size" value="48"/><default name="bases" value="3"/>'
    return f'<scene version="3.0.0">{defaults}{veil}{parts}{surface}{shape}</scene>'


if __name__ == "__main__":
    main()
