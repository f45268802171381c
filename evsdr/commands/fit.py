"""`python -m evsdr.fit scene.xml events.h5`: recover normals and absolute reflectance from a recording."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from evsdr.commands.console import print_table, run_command
from evsdr.files.atomic import check_folder
from evsdr.files.results import write_results
from evsdr.fitting.story import recover


@dataclass(frozen=True)
class Options:
    """Recover surface normals and absolute spectral reflectance from events under a ring of LEDs."""

    scene: tyro.conf.Positional[Path]
    """Scene file: camera, LEDs, object."""
    events: tyro.conf.Positional[Path]
    """Recording, an events.h5."""
    out: Path | None = None
    """Folder for the results; by default named after the recording."""
    truth: Path | None = None
    """truth.npz to compare with."""
    preset: Literal["fast", "balanced", "accurate"] = "balanced"
    """Speed against accuracy."""
    solver: Literal["lm", "adam"] = "lm"
    """Per-pixel Levenberg-Marquardt, or the decoder of the EventSpecPS paper."""
    shadows: Literal["auto", "off", "scene", "estimate", "downweight"] = "auto"
    """Cast shadows: left out, traced on the scene's geometry, traced on the depth that the fitted normals give,
    down-weighted as outliers, or decided from what they would change."""
    leds: Literal["auto", "near", "far"] = "auto"
    """LEDs at finite distance: direction and fall-off per pixel, one for all pixels, or decided from the parallax."""
    light_paths: Literal["auto", "direct", "indirect"] = "auto"
    """Light by way of other surfaces; auto models it where max_depth of the scene is above 1 and it counts."""
    gloss: Literal["auto", "off", "lobe", "blinn-phong", "gate"] = "auto"
    """Highlights: left out, a rough dielectric coating or a Blinn-Phong lobe fitted with the maps, the angular gate of
    the EventSpecPS paper, or decided from the residuals: the coating, or nothing."""
    thresholds: Literal["auto", "known", "estimate"] = "auto"
    """Contrast thresholds: as the recording tells, or estimated per pixel; auto estimates them where it tells
    one value for all pixels."""
    refractory: Literal["auto", "known", "estimate"] = "auto"
    """Refractory period of the sensor: as the recording tells, or estimated; auto estimates it where the recording
    does not tell it."""
    lag: Literal["auto", "off"] = "auto"
    """Lag of the photoreceptors in dim light: estimated if the events show one, or left out."""
    priors: str = "normal,integrable,reflectance,spectra"
    """What pixels tell of each other, or none: smooth normals, slopes of one surface, smooth reflectance, spectra
    of few kinds. Edges stay, and the data decide how strong each is."""
    init: Literal["frontal", "geometry"] = "frontal"
    """Start value of the normals."""
    mask: Path | None = None
    """Image (PNG or .npy) whose non-zero pixels are solved."""
    seed: int = 0
    """Seed of everything random."""
    define: Annotated[tuple[str, ...], tyro.conf.arg(aliases=["-D"]), tyro.conf.UseAppendAction] = field(
        default=()
    )
    """name=value for a <default> parameter of the scene file; may be repeated."""
    device: Literal["cpu", "gpu"] = "cpu"
    """Where to compute; gpu needs an NVIDIA card."""


def main(argv: list[str] | None = None) -> int:
    """Run the command; gives its exit status."""
    return run_command("fit", Options, command, argv)


def command(options: Options) -> None:
    """Fit, write the results, print a table."""
    out = options.out or options.events.with_name(options.events.stem)
    check_folder(out)
    maps, summary, surface = recover(options)
    write_results(out, maps, summary, surface)
    rows = [(f"{name} [s]", f"{seconds:.2f}") for name, seconds in summary["seconds"].items()]
    rows += [(name, f"{value:.4f}") for name, value in summary.get("error", {}).items()]
    print_table(f"{options.scene} {options.events}", rows)
    for effect, decision in summary["model"].items():
        print(f"{effect}: {decision}")
    print(f"pictures: {out / 'normal.png'}, {out / 'reflectance.png'}; all else in {out}")
