"""The entrance from Python: load a scene, fit a recording, and what a fit gives.

Mitsuba must know its libLLVM before it is imported, so whatever imports it is imported here when it is called.
"""

import gc
import importlib
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from evsdr import jit
from evsdr.errors import InputWarning
from evsdr.files.atomic import check_folder
from evsdr.files.events_h5 import read_recording
from evsdr.fitting.budget import budget_of
from evsdr.fitting.settings import Settings, check_settings
from evsdr.light.entry import open_scene
from evsdr.progress import Progress, Seconds, silent
from evsdr.records import Maps, Recording, Signals, Truth
from evsdr.threads import small_matrices

SOLVE = "solve"  # the stage from which on there is a best so far
STORY = "evsdr.fitting.story"  # whose modules load Mitsuba
VARIANTS = {"cpu": "llvm_ad_spectral", "gpu": "cuda_ad_spectral"}


@dataclass(frozen=True)
class Fit:
    """What a fit found.

    Attributes
    ----------
    maps : Maps
        Normals and reflectances, with their standard deviations.
    decisions : dict of Decision
        What was decided on each effect, and why.
    solution : Solution
        What the solver found, pixel after pixel.
    summary : dict
        What was modelled and why, numbers, residuals, warnings, seconds per stage.
    surface : dict of callable (path)
        What writes `depth.exr` and `mesh.ply`; empty where no pixel is known.
    depth : Depth, optional
        Of all pixels solved; None where no pixel is known.
    signals : Signals, optional
        Light of each LED, as the maps have it and as events tell it; None where there are too many pixels.
    truth : Truth, optional
        What is true, if that was told: `report.html` shows how far the maps are from it.
    """

    maps: Maps
    decisions: dict
    solution: object
    summary: dict
    surface: dict[str, Callable[[Path], None]]
    depth: object = None
    signals: Signals | None = None
    truth: Truth | None = None

    @property
    def verdict(self) -> str:
        """Say what to think of it: `trustworthy`, or `doubtful: ...` or `contradicted: ...` with the reasons."""
        return self.summary["verdict"]

    @property
    def contradicted(self) -> bool:
        """Whether what was recorded contradicts the files."""
        return self.verdict.startswith("contradicted")

    def save(self, folder: str | Path, report: bool = True) -> None:
        """Write all files of `python -m evsdr.fit` into a folder, made if missing: all or none.

        Parameters
        ----------
        folder : str or Path
        report : bool
            Whether `report.html` is among them; else one of an earlier fit goes.

        Raises
        ------
        InputError
            The folder can't be written.
        """
        from evsdr.files.results import write_results
        from evsdr.page.document import write_report

        check_folder(Path(folder))
        more = dict(self.surface)
        if report:
            shown = self.maps, self.summary, self.signals, self.depth, self.truth
            more["report.html"] = lambda path: write_report(path, *shown)
        write_results(folder, self.maps, self.summary, more)
        if not report:
            (Path(folder) / "report.html").unlink(missing_ok=True)  # of an earlier fit


def start(device: str | None = None) -> None:
    """Start Mitsuba on `cpu` or `gpu`, and import what fits; None keeps what runs, or takes the first.

    Raises
    ------
    InputError
        There is no such device or library, or Mitsuba already runs on the other.
    """
    jit.start(VARIANTS[device] if device else None)
    if STORY not in sys.modules:
        importlib.import_module(STORY)
        gc.freeze()  # what is imported stays, and need not be looked through: 8.1 s for 8.6 of a fit of 64 x 64


def load_scene(scene: str | Path | dict, /, **define):
    """Load and check a scene; starts Mitsuba if nobody has.

    Parameters
    ----------
    scene : str, Path or dict
        A scene.xml, or a dictionary as of `mitsuba.load_dict`.
    **define
        Values for the file's `<default>` parameters.

    Returns
    -------
    RingScene

    Raises
    ------
    InputError
        The scene is missing or wrong.
    """
    return open_scene(scene, {name: str(value) for name, value in define.items()})


def fit(
    scene,
    recording: Recording | str | Path,
    settings: Settings = Settings(),
    mask: np.ndarray | str | Path | None = None,
    progress: Progress | None = None,
) -> Fit:
    """Recover normals and reflectances from a recording.

    Parameters
    ----------
    scene : RingScene, path or dict
        See `load_scene`.
    recording : Recording, or path
        Events with sensor and schedule, or an events.h5.
    settings : Settings
        What is asked of each effect, and how hard to try.
    mask : (height, width) bool, or path, optional
        Pixels to solve; by default all of the object.
    progress : callable (stage, share) -> bool, optional
        Told what is under way, and which share of it, 0..1, is done. Once it gives True the fit ends as soon as it can
        with the best so far: `stopped` in the summary says so, and the verdict is doubtful.

    Raises
    ------
    InputError
        Something given can't be used.

    Warns
    -----
    InputWarning
        Something given can be used, but the user should know; also in the summary.
    """
    check_settings(settings)
    began = time.perf_counter()
    with collected_warnings() as messages:
        start()
        from evsdr.fitting.story import fit_recording
        from evsdr.light.scene import RingScene

        recording = recording if isinstance(recording, Recording) else read_recording(recording)
        ring = scene if isinstance(scene, RingScene) else load_scene(scene)
        plan = budget_of(settings, recording, began, ring.shape_is_known)
        seconds = Seconds(plan.watch(progress or silent) if plan else progress)
        with small_matrices():
            found = fit_recording(ring, recording, plan.settings if plan else settings, mask, seconds)
    more = plan.told(found.summary["stopped"]) if plan else {}
    return replace(found, summary=found.summary | more | {"warnings": messages, "seconds": seconds.seconds})


@contextmanager
def collected_warnings() -> Iterator[list[str]]:
    """Keep back warnings, and give each once at the end; gives the list of their texts, then complete."""
    messages: list[str] = []
    caught: list = []
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", InputWarning)
            yield messages
    finally:
        once = {str(warning.message): warning.message for warning in caught}
        messages += once
        for warning in once.values():
            warnings.warn(warning, stacklevel=4)
