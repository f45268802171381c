"""Fit recordings in a home folder where nothing is compiled yet, then others of the same scene."""

import tempfile
from dataclasses import dataclass
from pathlib import Path

from experiments.fitting import SCENES, run

CACHE = ".drjit"  # in the home folder: where Dr.Jit keeps compiled kernels


@dataclass(frozen=True)
class Fit:
    """One `python -m evsdr.fit`: kernels that it compiled, seconds from start to written files."""

    kernels: int
    seconds: float


def fit_in_turn(scene: str, size: int, n_fit: int = 2, seed: int = 500) -> list[Fit]:
    """Fit recordings of a scene, each another one, in a home folder that is empty before the first.

    An EVK4 records them and tells one value for all thresholds.

    Parameters
    ----------
    scene : str
        Name of a scene of `scenes/`.
    size : int
        Width and height [pixels].
    n_fit : int
    seed : int
        Of the first recording.
    """
    file, define = str(SCENES / f"{scene}.xml"), ["-D", f"size={size}"]
    fits = []
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder, "home")
        home.mkdir()
        for k in range(n_fit):
            out = f"{folder}/{k}"
            told = ["--thresholds", "nominal", "--seed", str(seed + k)]
            run("evsdr.simulate", [file, "--out", out, *define, *told])  # in the user's own home
            before = count_kernels(home)
            seconds, _ = run(
                "evsdr.fit", [file, f"{out}/events.h5", *define, "--out", f"{out}/fit"], str(home)
            )
            fits.append(Fit(count_kernels(home) - before, seconds))
    return fits


def count_kernels(home: Path) -> int:
    """Count the kernels that Dr.Jit keeps in a home folder."""
    return sum(path.suffix == ".bin" for path in (home / CACHE).glob("*"))
