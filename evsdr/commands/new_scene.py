"""`python -m evsdr.new_scene leds.csv --size 512 512 ...`: write a scene from a few figures and a table of LEDs."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from evsdr.commands.console import print_table, run_command
from evsdr.errors import InputError
from evsdr.files.atomic import atomic_path


@dataclass(frozen=True, kw_only=True)
class Options:
    """Write a scene file from a few figures of the camera and a table of LEDs.

    The table is a CSV with a line per LED in the order in which they are lit, and columns by name: x y z, or azimuth_deg
    polar_deg and perhaps distance; wavelength_nm and perhaps width_nm, or spectrum (a CSV beside it); perhaps power, or
    intensity, and size. Lengths are in one unit; x goes right, y up, z toward the camera, from the middle of the object.
    """

    leds: tyro.conf.Positional[Path]
    """Table of the LEDs, a CSV."""
    size: tuple[int, int]
    """Width and height of the sensor region that is recorded [pixels]."""
    field_width: float | None = None
    """Width of what the camera sees at the object [scene units]: an orthographic camera, far away or telecentric."""
    focal_mm: float | None = None
    """Focal length [mm], for a perspective camera; with --distance."""
    pixel_um: float = 4.86
    """Width of a pixel [um]; that of an EVK4 by default."""
    distance: float | None = None
    """From the camera to the middle of the object [scene units]."""
    center: tuple[float, float] | None = None
    """Column and row at which the optical axis meets the sensor region [pixels]; its middle by default."""
    sphere: float | None = None
    """The object is a sphere of this radius [scene units]."""
    mesh: Path | None = None
    """The object is this mesh (PLY or OBJ), in scene units. Without either its shape is unknown."""
    constant_light: float = 0.05
    """C_w: constant light on the sensor, in the unit of the LEDs' powers."""
    unit: Literal["um", "mm", "cm", "m"] | None = None
    """Unit of all lengths."""
    out: Path | None = None
    """File to write; by default the table's name with .xml."""


def main(argv: list[str] | None = None) -> int:
    """Run the command; gives its exit status."""
    return run_command("new_scene", Options, command, argv)


def command(options: Options) -> None:
    """Read the table, write the scene, load it, print what came out."""
    from evsdr.rig.led_table import read_leds
    from evsdr.rig.scene_writer import camera_of, scene_xml

    out = options.out or options.leds.with_suffix(".xml")
    check_target(out, options.leds)
    check_object(options)
    camera = camera_of(
        options.size,
        options.field_width,
        options.focal_mm,
        options.pixel_um,
        options.distance,
        options.center,
    )
    leds = read_leds(options.leds)
    mesh = options.mesh and os.path.relpath(options.mesh.resolve(), out.resolve().parent)
    with atomic_path(out) as temporary:
        text = scene_xml(camera, leds, options.constant_light, options.unit, options.sphere, mesh)
        temporary.write_text(text, encoding="utf-8")
        ring = load(temporary, out)
    unit = options.unit or "scene units"
    bands = ring.leds.band_wavelength_nm
    rows = [
        ("LEDs", f"{len(leds)}, {'near' if ring.is_near else 'far'}"),
        (f"bands: {len(bands)}", ", ".join(f"{nm:.0f}" for nm in bands) + " nm"),
        ("camera", "perspective" if camera.perspective else "orthographic"),
        ("a pixel sees, at the object", f"{camera.field / camera.size[0]:.4g} {unit}"),
        ("object", "a mesh" if mesh else "a sphere" if options.sphere else "of unknown shape"),
        ("C_w", f"{options.constant_light:g}"),
    ]
    print_table(str(out), rows)
    print(f"what this ring can tell: python -m evsdr.design {out}")


def check_target(out: Path, table: Path) -> None:
    """Refuse to replace a file that this command has not written."""
    from evsdr.rig.scene_writer import MARK

    if out.resolve() == table.resolve():
        raise InputError(f"{out}: this is the table itself; give another file by --out.")
    if out.exists():
        with out.open("rb") as file:
            if MARK.encode() not in file.read(200):
                raise InputError(
                    f"{out}: this file is not of this command; give another by --out, or remove it."
                )


def check_object(options: Options) -> None:
    """Refuse an object that is told twice, or of a kind that can't be."""
    if options.sphere is not None and options.mesh is not None:
        raise InputError("--sphere and --mesh tell the same; give one of them.")
    if options.sphere is not None and not 0 < options.sphere < 1e12:
        raise InputError(f"--sphere is {options.sphere:g}; give a radius above 0.")
    if options.mesh and (options.mesh.suffix.lower() not in (".ply", ".obj") or not options.mesh.is_file()):
        raise InputError(f"{options.mesh}: this is no PLY or OBJ file; save the mesh as one.")
    if not 0 <= options.constant_light < 1e12:
        raise InputError(f"--constant-light is {options.constant_light:g}; give 0 or more.")


def load(written: Path, named: Path):
    """Load what was written, as a fit will; sentences name the file that it becomes."""
    from evsdr.light.entry import open_scene

    try:
        return open_scene(written)
    except InputError as error:
        raise InputError(str(error).replace(str(written), str(named))) from error
