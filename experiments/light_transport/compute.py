"""What each modelled effect of light transport buys and costs, for scenes that need it and scenes that don't."""

import re
import shutil
import warnings
from dataclasses import dataclass
from pathlib import Path

import evsdr
from evsdr import InputWarning, Recording, Settings, Truth

REPOSITORY = Path(__file__).resolve().parents[2]
SCENES = REPOSITORY / "scenes"
DISTANCE = 300.0  # times that of the near ring


@dataclass(frozen=True)
class Case:
    """An effect, tried on one recording.

    Attributes
    ----------
    effect : str
    scene : str
        What is recorded, of `scenes/`; or `distant_ring`, see `write_distant_ring`.
    fitted : str
        What is fitted: the same, or one whose object is a placeholder.
    define : dict
        Parameters of both.
    ways : dict of dict
        Settings of the fit by name: without the effect, with it, and as `auto` decides.
    decision : str
        The entry of the summary's `model` that says what `auto` decided.
    """

    effect: str
    scene: str
    fitted: str
    define: dict
    ways: dict
    decision: str


@dataclass(frozen=True)
class Result:
    """Errors and cost of one way: degrees, RMSE, seconds of the fit; and what was decided."""

    way: str
    mae_deg: float
    rmse: float
    seconds: float
    decision: str


def _ways(option: str, without: str, with_: str) -> dict:
    return {name: {option: name} for name in (without, with_, "auto")}


SHADOWS, UNKNOWN = _ways("shadows", "off", "scene"), _ways("shadows", "off", "estimate")
LEDS, PATHS = _ways("leds", "far", "near"), _ways("light_paths", "direct", "indirect")
GLOSS = _ways("gloss", "off", "lobe")
CASES = (
    Case("cast shadows", "sphere", "sphere", {}, SHADOWS, "cast shadows"),
    Case("cast shadows", "sphere_pole", "sphere_pole", {}, SHADOWS, "cast shadows"),
    Case("shape unknown", "relief", "relief_unknown", {}, UNKNOWN, "cast shadows"),
    Case("near LEDs", "near_ring", "near_ring", {}, LEDS, "LEDs"),
    Case("near LEDs", "distant_ring", "distant_ring", {}, LEDS, "LEDs"),
    Case("indirect light", "relief", "relief", {"max_depth": 3}, PATHS, "light paths"),
    Case("indirect light", "two_spheres", "two_spheres", {"max_depth": 3}, PATHS, "light paths"),
    Case("gloss", "sphere", "sphere", {}, GLOSS, "gloss"),
    Case("gloss", "glossy_sphere", "glossy_sphere", {}, GLOSS, "gloss"),
)


def scene_file(name: str, folder: Path) -> Path:
    """Find a scene by its name."""
    file = SCENES / f"{name}.xml"
    return file if file.is_file() else folder / file.name


def write_distant_ring(folder: Path) -> None:
    """Write the near ring's scene with the ring DISTANCE times as far and as much stronger."""
    shutil.copytree(SCENES, folder, dirs_exist_ok=True)
    rig = (SCENES / "ring24_near.xml").read_text()
    rig = re.sub(r' ([xyz])="([-\d.e]+)"', lambda m: f' {m[1]}="{DISTANCE * float(m[2])}"', rig)

    def stronger(values):
        return (
            'name="values" value="' + " ".join(f"{DISTANCE**2 * float(v):g}" for v in values[1].split()) + '"'
        )

    (folder / "ring24_near.xml").write_text(re.sub(r'name="values" value="([^"]*)"', stronger, rig))
    (folder / "near_ring.xml").rename(folder / "distant_ring.xml")


def run(case: Case, folder: Path, size: int) -> list[Result]:
    """Record once, fit without the effect, with it, and as `auto` decides."""
    if case.scene == "distant_ring":
        write_distant_ring(folder)
    recorded = evsdr.load_scene(scene_file(case.scene, folder), size=size, **case.define)
    recording, truth = evsdr.simulate(recorded)
    fitted = scene_file(case.fitted, folder), {"size": size, **case.define}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        fit_one(case, *fitted, recording, truth, *next(iter(case.ways.items())))  # compiles
        return [fit_one(case, *fitted, recording, truth, *way) for way in case.ways.items()]


def fit_one(
    case: Case, file: Path, define: dict, recording: Recording, truth: Truth, name: str, settings: dict
) -> Result:
    """Fit in one way."""
    found = evsdr.fit(evsdr.load_scene(file, **define), recording, Settings(**settings))
    error, seconds = evsdr.score(found.maps, truth), sum(found.summary["seconds"].values())
    decision = found.summary["model"][case.decision]
    return Result(name, error["mae_deg"], error["rmse"], seconds, decision)
