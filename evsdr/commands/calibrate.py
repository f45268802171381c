"""`python -m evsdr.calibrate directions|powers|thresholds|reference|scale|pose|from-fit`: measure a rig.

Each writes what the scene file or the recording takes, calibration.json with every estimate and its sigma,
and residuals.png.
"""

import json
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated, Literal, Union

import tyro

from evsdr import __version__, jit
from evsdr.commands.calibrate_tables import rows_of
from evsdr.commands.console import print_table, run_command
from evsdr.errors import parse_definitions
from evsdr.files.atomic import atomic_folder, check_folder
from evsdr.progress import Progress, Stages

Define = Annotated[tuple[str, ...], tyro.conf.arg(aliases=["-D"]), tyro.conf.UseAppendAction]
TWELVE = tuple(str(k) for k in range(1, 13))


@dataclass(frozen=True)
class Directions:
    """LED directions, or positions, from a matt or mirror ball under the ring."""

    scene: tyro.conf.Positional[Path]
    """Scene file with the camera, and the LEDs roughly where they are."""
    events: tyro.conf.Positional[Path]
    """Recording of the ball under the ring, an events.h5; thresholds calibrated."""
    ball: Literal["matt", "mirror"] = "matt"
    """Surface of the ball. A mirror ball gives directions only and needs --circle or --mask."""
    circle: tuple[float, float, float] | None = None
    """Column and row of the ball's centre, and its radius [pixels]; found from the events by default."""
    mask: Path | None = None
    """Image (PNG or .npy) whose non-zero pixels are the ball, instead of --circle."""
    circle_sigma: float = 0.1
    """How well the outline of a mirror ball is known [pixels]; a tenth turns LEDs by 0.4 degrees on a ball of 40 pixels in radius."""
    near: bool = False
    """Estimate positions; needs --radius."""
    radius: float | None = None
    """True radius of the ball [scene units]."""
    center_z: float = 0.0
    """How far the ball's centre lies from the scene's origin toward an orthographic camera [scene units]."""
    out: Path | None = None
    """Folder for the results; by default out/calibrate_directions."""
    seed: int = 0
    """Seed of the choice of events where there are very many."""
    define: Define = field(default=())
    """name=value for a <default> parameter of the scene file; may be repeated."""


@dataclass(frozen=True)
class Powers:
    """Relative LED powers and the constant light C_w from a white patch at several tilts.

    Events tell ratios: powers and C_w come in the unit in which the mean power is that of the scene file;
    absolute reflectance needs no more. Dark slots (-1 in order) between the LEDs help much.
    """

    scene: tyro.conf.Positional[Path]
    """Scene file with the camera and the calibrated directions. For near LEDs its object stands where the
    patch was."""
    patches: tyro.conf.Positional[tuple[str, ...]]
    """Per tilt `events.h5:nx,ny,nz` with the patch's normal in the camera frame (x right, y up, z toward the
    camera), and optionally `:mask.png`."""
    reflectance: str = "0.99"
    """Of the patch: a number, or a CSV of wavelength and reflectance."""
    tilt_sigma_deg: float = 0.5
    """How well the normals are known [deg]; they are refined within it."""
    out: Path | None = None
    """Folder for the results; by default out/calibrate_powers."""
    seed: int = 0
    """Seed of the choice of events where there are very many."""
    define: Define = field(default=())
    """name=value for a <default> parameter of the scene file; may be repeated."""


@dataclass(frozen=True)
class Thresholds:
    """Contrast thresholds per pixel from a flicker of known waveform that all pixels see."""

    events: tyro.conf.Positional[Path]
    """Recording of the flicker, an events.h5; triggers mark the middle of each rise."""
    waveform: str = "sine-log"
    """sine-log or triangle-log (of log intensity), sine or triangle (of intensity), or a CSV of phase and
    intensity; or ring, for the flicker of the ring itself (capture --flicker), whose depth is found."""
    depth: float = 2.0
    """Log intensity from peak to peak; for sine and triangle (max - min) / (max + min)."""
    period_us: float | None = None
    """Period of the flicker [us]; by default a round of the recording's schedule."""
    start_us: float | None = None
    """Start of one period [us], where there are no triggers."""
    apply: tuple[Path, ...] = ()
    """Recordings to copy into the results with these thresholds."""
    out: Path | None = None
    """Folder for the results; by default out/calibrate_thresholds."""


@dataclass(frozen=True)
class Reference:
    """Reference reflectance in the LED bands from measured spectra: CSV in, table of patches x bands out."""

    scene: tyro.conf.Positional[Path]
    """Scene file with the LEDs."""
    spectra: str = "babel"
    """CSV: wavelength [nm], then a column per patch. Or babel (mean of 30 ColorCheckers), or ohta."""
    patches: tuple[str, ...] = TWELVE
    """Names or numbers of the patches to evaluate; by default the first twelve."""
    reserved: str | None = "19"
    """Name or number of the patch that sets the scale; by default the white one."""
    white: str | None = None
    """Column with the white patch, where the columns are intensities under one light."""
    white_reflectance: float = 1.0
    """Reflectance of that white patch."""
    out: Path | None = None
    """Folder for the results; by default out/calibrate_reference."""
    define: Define = field(default=())
    """name=value for a <default> parameter of the scene file; may be repeated."""


@dataclass(frozen=True)
class Scale:
    """Absolute scale from one reserved patch of a chart, evaluated on the others."""

    maps: tyro.conf.Positional[Path]
    """maps.npz that evsdr.fit wrote for the chart."""
    reference: Path
    """reference.csv of the patches to evaluate."""
    reserved: Path
    """reserved.csv of the patch that sets the scale."""
    corners: tuple[float, float, float, float, float, float, float, float] | None = None
    """Column and row of the chart's four corners [pixels]: at patch 1, then clockwise."""
    rows: int = 4
    """Rows of patches."""
    columns: int = 6
    """Columns of patches."""
    gap: float = 0.0
    """Border between patches and around them, in widths of a patch."""
    labels: Path | None = None
    """Instead of corners: a .npy image with the number of the patch at each pixel, 0 for none."""
    constant_light: float | None = None
    """C_w that the fit used; scaled, it goes to constant_light.xml."""
    out: Path | None = None
    """Folder for the results; by default out/calibrate_scale."""


@dataclass(frozen=True)
class Pose:
    """Pose of a CAD model in the camera view, and its normal map as ground truth."""

    scene: tyro.conf.Positional[Path]
    """Scene file with the camera; the model replaces its object."""
    mesh: tyro.conf.Positional[Path]
    """The model, in any format that trimesh reads."""
    points: Path | None = None
    """CSV of x_pixel,y_pixel,X,Y,Z: where points of the model are seen; four or more."""
    mask: Path | None = None
    """Image (PNG or .npy) of the object's silhouette."""
    maps: Path | None = None
    """maps.npz whose normals refine the pose; not for a pose that judges these normals."""
    unit: Annotated[float, tyro.conf.arg(aliases=["--model-unit"])] = 1.0
    """Scene units per unit of the model."""
    center_z: float = 0.0
    """How far the model's middle lies from the scene's origin toward the camera, to start from [scene
    units]."""
    face_normals: bool = False
    """Flat faces, as of a model with sharp edges, instead of smooth normals."""
    spp: int = 16
    """Rays per pixel of the normal map."""
    out: Path | None = None
    """Folder for the results; by default out/calibrate_pose."""
    define: Define = field(default=())
    """name=value for a <default> parameter of the scene file; may be repeated."""


@dataclass(frozen=True)
class FromFit:
    """LEDs with the powers and directions that a fit found, as an include for the next scene."""

    scene: tyro.conf.Positional[Path]
    """Scene file of the fit."""
    results: tyro.conf.Positional[Path]
    """summary.json of the fit, or the folder of its results."""
    out: Path | None = None
    """Folder for the results; by default out/calibrate_from-fit."""
    define: Define = field(default=())
    """name=value for a <default> parameter of the scene file; may be repeated."""


Options = Union[Directions, Powers, Thresholds, Reference, Scale, Pose, FromFit]


def main(argv: list[str] | None = None) -> int:
    """Run the command; gives its exit status."""
    return run_command("calibrate", Options, command, argv)


def command(options: Options) -> None:
    """Calibrate, write, print."""
    name = "from-fit" if isinstance(options, FromFit) else type(options).__name__.lower()
    out = options.out or Path("out") / f"calibrate_{name}"
    check_folder(out)
    with atomic_folder(out, "calibration.json") as folder:
        with Stages(f"calibrate {name}", ("estimate",)) as stages, stages.stage("estimate") as advance:
            result = _calibrate(options, folder, advance)
        text = json.dumps({"evsdr": __version__, "calibrate": name, **result}, indent=2, allow_nan=False)
        (folder / "calibration.json").write_text(text + "\n", encoding="utf-8")
    print_table(f"calibrate {name}", rows_of(name, result))
    print(f"picture: {out / 'residuals.png'}; all else in {out}")


def _calibrate(options: Options, folder: Path, progress: Progress) -> dict:
    """Read, estimate, write; gives what calibration.json holds."""
    asked = {"folder": folder, **vars(options)}
    del asked["out"]
    if "define" in asked:
        asked["define"] = parse_definitions(options.define)
    if isinstance(options, (Directions, Powers, Pose, FromFit)):
        jit.start()  # before what imports Mitsuba
    if isinstance(options, (Directions, Powers, Thresholds, Pose)):
        asked["progress"] = progress
    match options:
        case Directions():
            from evsdr.calibration.leds import Ball, directions

            asked["surface"] = asked.pop("ball")
            return directions(**_gather("ball", Ball, asked))
        case Powers():
            from evsdr.calibration.powers import powers

            return powers(**asked)
        case Thresholds():
            from evsdr.calibration.thresholds import thresholds

            return thresholds(**asked)
        case Reference():
            from evsdr.calibration.reference import reference

            return reference(**asked)
        case Scale():
            from evsdr.calibration.reference import Patches, scale

            return scale(**_gather("patches", Patches, asked))
        case Pose():
            from evsdr.calibration.cad import Cad, pose

            return pose(**_gather("cad", Cad, asked))
        case FromFit():
            from evsdr.calibration.from_fit import from_fit

            return from_fit(**asked)


def _gather(name: str, record: type, asked: dict) -> dict:
    """Put those arguments that are fields of a record into one, under that name."""
    inside = {field.name for field in fields(record)}
    outside = {key: value for key, value in asked.items() if key not in inside}
    return {name: record(**{key: asked[key] for key in inside}), **outside}
