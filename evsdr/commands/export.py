"""`python -m evsdr.export RESULTS --to FORMAT`: hand the results of a fit on to other programs."""

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from evsdr.commands.console import print_table, run_command
from evsdr.errors import InputWarning

Format = Literal["envi", "openlime", "gltf", "tiff", "colmap", "csv"]


@dataclass(frozen=True, kw_only=True)
class Options:
    """Hand the results of a fit on to other programs. Bands are in the order of their wavelengths."""

    results: tyro.conf.Positional[Path]
    """Folder that a fit wrote."""
    to: Format
    """envi: cubes of reflectance and its sigma; openlime: pictures and info.json for OpenLIME; gltf: the surface with
    colour and normal map, .glb; tiff: a float TIFF of each map; colmap: a dense workspace for a
    perspective camera: its model, depth and normals; csv: a line for each known pixel."""
    out: Path | None = None
    """Folder to write to; by default one of the format's name in that of the results."""
    unit: Literal["um", "mm", "cm", "m"] | None = None
    """Unit of the scene; by default what its file states. With it lengths are in millimetres (glTF: metres)."""


def main(argv: list[str] | None = None) -> int:
    """Run the command; gives its exit status."""
    return run_command("export", Options, command, argv)


def command(options: Options) -> None:
    """Read, write, print what was written."""
    from evsdr.exports.colmap import write_colmap
    from evsdr.exports.envi import write_envi
    from evsdr.exports.gltf import write_gltf
    from evsdr.exports.openlime import write_openlime
    from evsdr.exports.source import read_source
    from evsdr.exports.table import write_csv
    from evsdr.exports.tiff import write_tiff
    from evsdr.files.atomic import atomic_folder

    writers = {
        "envi": write_envi,
        "openlime": write_openlime,
        "gltf": write_gltf,
        "tiff": write_tiff,
        "colmap": write_colmap,
        "csv": write_csv,
    }
    source = read_source(options.results, options.unit)
    if source.unit == "scene" and options.to != "envi":
        message = f"{options.results}: nobody tells how long the scene's unit is; lengths stay in it unless --unit does."
        warnings.warn(InputWarning(message), stacklevel=1)
    out = options.out or options.results / options.to
    with atomic_folder(out) as temporary:
        writers[options.to](temporary, source)
        files = sorted(file for file in temporary.rglob("*") if file.is_file())
        rows = [(str(file.relative_to(temporary)), f"{file.stat().st_size:,} bytes") for file in files]
    print_table(str(out), rows)
