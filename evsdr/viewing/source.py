"""Any file of events, as far as it tells: events, trigger edges, and perhaps sensor and schedule."""

from dataclasses import dataclass, replace
from pathlib import Path

import h5py
import numpy as np

from evsdr.errors import InputError
from evsdr.files.events_h5 import SENSOR_DEFAULTS, read_recording
from evsdr.files.hdf5 import member
from evsdr.records import Events, Recording, Schedule, Sensor
from evsdr.rig.camera_file import Edges, between
from evsdr.rig.log import read_ring_log
from evsdr.rig.reader import read_camera_file

MOST_EVENTS = 30_000_000  # that are looked at, from the first on: they take some GB and a minute; guessed


@dataclass(frozen=True)
class Watched:
    """What a file tells.

    Attributes
    ----------
    path : Path
    events : Events
        The first `MOST_EVENTS`.
    edges : Edges
        Of all trigger inputs.
    sensor : Sensor
        Defaults, named in `guessed`, where the file does not tell.
    schedule : Schedule, optional
    n_event : int
        In the file.
    """

    path: Path
    events: Events
    edges: Edges
    sensor: Sensor
    schedule: Schedule | None
    n_event: int

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width [pixels]."""
        return self.sensor.height, self.sensor.width

    @property
    def starts(self) -> np.ndarray:
        """Give the times of all rising edges [us]."""
        return self.edges.t[self.edges.p == 1]

    @property
    def seconds(self) -> float:
        """Time from the first event to the last [s]."""
        return 1e-6 * float(self.events.t[-1] - self.events.t[0])

    def recording(self, schedule: Schedule, starts: np.ndarray) -> Recording:
        """Give it as a recording under a schedule with these starts of rounds."""
        return Recording(self.events, self.sensor, schedule, starts, str(self.path))


def open_watched(
    path: Path,
    ring: Path | None = None,
    size: tuple[int, int] | None = None,
    start_us: float | None = None,
    triggers: Path | None = None,
    most: int = MOST_EVENTS,
) -> Watched:
    """Open any file of events.

    Parameters
    ----------
    path : Path
        An events.h5, or a camera's file.
    ring : Path, optional
        Log of the ring, for a camera's file: it tells the schedule.
    size : (width, height), optional
        Of the sensor, where the file does not tell.
    start_us : float, optional
        Start of the first round [us], for a log of the ring and a file without triggers.
    triggers : Path, optional
        A file of triggers beside a camera's file, see `evsdr.rig.side_triggers`.
    most : int
        Events to look at.

    Raises
    ------
    InputError
        A file can't be used.
    """
    if has_schedule(path):
        recording = read_recording(path)
        start = np.asarray(recording.round_start_us)
        edges = Edges(np.ones(len(start), np.int8), start, np.zeros(len(start), np.int16))
        events, sensor, schedule = recording.events, recording.sensor, recording.schedule
    else:
        camera = read_camera_file(path, size, triggers)
        events, edges, schedule = camera.events, camera.edges, None
        sensor = Sensor(camera.width, camera.height, **SENSOR_DEFAULTS, guessed=tuple(SENSOR_DEFAULTS))
    if ring is not None:
        schedule = schedule_of(path, ring, edges, start_us)
    if len(events) < 2 or events.t[-1] <= events.t[0]:
        raise InputError(f"{path}: it holds {len(events)} events at one time; record again with the ring on.")
    n = len(events)
    if n > most:
        events = between(events, events.t[0], events.t[most])
    return Watched(Path(path), events, edges, sensor, schedule, n)


def schedule_of(path: Path, ring: Path, edges: Edges, start_us: float | None) -> Schedule:
    """Give the schedule of a log of the ring."""
    log, rising = read_ring_log(ring), edges.t[edges.p == 1]
    if start_us is None and not len(rising):
        raise InputError(
            f"{path}: it holds no trigger edges, so that nothing tells when rounds start; give --start-us, or look at it "
            "without --ring."
        )
    return Schedule(log.order, log.slot_us, log.crossfade, float(rising[0] if start_us is None else start_us))


def has_schedule(path: Path) -> bool:
    """Tell whether a file is an events.h5, which tells its schedule."""
    try:
        if not (path.is_file() and h5py.is_hdf5(path)):
            return False
        with h5py.File(path, "r") as file:
            return isinstance(member(file, "schedule"), h5py.Group)
    except OSError:
        return False


def with_slots(schedule: Schedule, round_us: float) -> Schedule:
    """Give a schedule whose rounds last so long."""
    return replace(schedule, slot_us=round_us / len(schedule.order))
