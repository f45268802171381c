"""How long a fit may take: which preset that allows on this machine, and when the solver must end."""

import os
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from evsdr.fitting.settings import Settings
from evsdr.progress import Progress
from evsdr.records import Recording
from evsdr.threads import in_chunks

BY_BUDGET = "time budget"  # what `stopped_by` of a summary says
# Of the budget that a preset may be expected to take. Measured on a blob of 256 x 256: `balanced`, when it took 31 s, had 0.22 degrees
# when it was asked to end in 20 (it took 26), 0.19 in 25 (28), and 0.80 in 15; `fast` had 0.75 in 14
MOST = 1.2
LEAST = 0.5  # of the budget that the solver gets, whatever the work after it may take


@dataclass(frozen=True)
class Cost:
    """Seconds of a fit on the machine of reference, whose `task_seconds` are `REFERENCE`.

    Attributes
    ----------
    start, pixel, event : float
        Of any fit, of each pixel solved, and of each event [s].
    """

    start: float
    pixel: float
    event: float

    def seconds(self, n_pixel: int, n_event: int) -> float:
        """Give the seconds of a fit."""
        return self.start + self.pixel * n_pixel + self.event * n_event


# Measured by experiments/speed_accuracy (blob, shape known, 32 to 256 pixels, 3 and 6 rounds, 2 cores; within a third), less the 2 s
# before the solver; from the best to the quickest
REFERENCE = 0.059
COST = {
    "accurate": Cost(4.2, 3.8e-4, 1.3e-6),
    "balanced": Cost(3.5, 3.2e-4, 1.7e-6),
    "fast": Cost(1.2, 2.1e-4, 1.0e-6),
}
# Times that, where the shape is not known and what hides LEDs is asked of events. Measured on a blob of 128 and of 256: 2.8 to 3.8; on Nefertiti
# of 96, of which less is hidden, 1.2
UNKNOWN_SHAPE = 3.0
# Of what follows: stages that are left end early, then surface, signals, files, page; guessed
AFTER = Cost(0.3, 6.0e-5, 1.0e-7)


@dataclass(frozen=True)
class Budget:
    """A fit that must end in time.

    Attributes
    ----------
    settings : Settings
        With the best preset that is expected to end in time, else the quickest.
    expected_s : float
        What that one is expected to take.
    end : float
        When the solver must end, by `time.perf_counter`.
    """

    settings: Settings
    expected_s: float
    end: float

    def watch(self, progress: Progress) -> Progress:
        """Give a progress that asks to end soon once it is time."""

        def tell(stage: str, share: float) -> bool:
            return bool(progress(stage, share)) | (time.perf_counter() > self.end)

        return tell

    def told(self, stopped: bool) -> dict:
        """Give what the summary says of it; `stopped` tells whether the solver was."""
        budget = {
            "seconds": self.settings.time_budget,
            "preset": self.settings.preset,
            "expected_seconds": self.expected_s,
        }
        return {"time_budget": budget} | ({"stopped_by": BY_BUDGET} if stopped else {})


def budget_of(
    settings: Settings, recording: Recording, began: float, shape_is_known: bool = True
) -> Budget | None:
    """Measure this machine and plan, if time is limited, by the pixels that fire; `began` and `shape_is_known` as in `plan`."""
    if not settings.time_budget:
        return None
    from evsdr.events.chosen import count_events  # starts Numba, which `import evsdr` does without

    events, sensor = recording.events, recording.sensor
    n_pixel = np.count_nonzero(count_events(events, (sensor.height, sensor.width)))
    return plan(settings, n_pixel, len(events), began, slowness(), shape_is_known)


def plan(
    settings: Settings,
    n_pixel: int,
    n_event: int,
    began: float,
    slowness: float,
    shape_is_known: bool = True,
) -> Budget:
    """Choose the preset that a budget allows.

    Parameters
    ----------
    settings : Settings
        `time_budget` counts; `preset` is replaced.
    n_pixel, n_event : int
        What is to be solved.
    began : float
        When the budget began, by `time.perf_counter`.
    slowness : float
        Seconds of this machine for each of that of reference.
    shape_is_known : bool
        Whether the scene tells it.
    """
    slower = slowness * (1.0 if shape_is_known or settings.shadows == "off" else UNKNOWN_SHAPE)
    expected = {name: slower * cost.seconds(n_pixel, n_event) for name, cost in COST.items()}
    left = began + settings.time_budget - time.perf_counter()
    preset = next((name for name in COST if expected[name] < MOST * left), "fast")
    after = min(slowness * AFTER.seconds(n_pixel, n_event), (1 - LEAST) * settings.time_budget)
    end = began + settings.time_budget - after
    return Budget(replace(settings, preset=preset), expected[preset], end)


def slowness() -> float:
    """Measure this machine: seconds that it takes for one of the machine of reference; the best of three."""
    return min(task_seconds() for _ in range(3)) / REFERENCE


def task_seconds() -> float:
    """Time a fixed task of NumPy on all threads [s].

    A stable sort: the default one is up to ten times quicker by wide registers, which fits are not.
    """
    start = time.perf_counter()
    in_chunks(lambda chunk: np.sort(np.random.default_rng(chunk).random(50_000), kind="stable"))
    return time.perf_counter() - start


def seconds_so_far() -> float:
    """Give how long this process runs [s], where the system tells; else 0."""
    try:
        started = int(Path("/proc/self/stat").read_text("utf-8").rpartition(")")[2].split()[19])
        now = float(Path("/proc/uptime").read_text("ascii").split()[0])
        return max(now - started / os.sysconf("SC_CLK_TCK"), 0.0)
    except (OSError, ValueError, IndexError):
        return 0.0
