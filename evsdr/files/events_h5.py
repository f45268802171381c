"""Recordings: read and write events.h5, the events together with sensor and schedule.

Layout: `CD/events` and `EXT_TRIGGER/events` as in Metavision's HDF5 files, root attributes `width` and
`height`, groups `sensor` and `schedule`.
"""

import io
import re
import warnings
from pathlib import Path

import h5py
import numpy as np

from evsdr.errors import InputError, InputWarning
from evsdr.files.atomic import atomic_path
from evsdr.files.hdf5 import check_readable, member, open_hdf5, read_all
from evsdr.files.pieces import PIECE, for_pieces
from evsdr.files.scratch import columns
from evsdr.records import Events, Recording, Schedule, Sensor

# Medians of an EVK4 (IMX636) at default biases, taken for what a file leaves out.
TOLERANCE = "contrast_threshold_tolerance"
SENSOR_DEFAULTS = {"contrast_threshold_on": 0.2525, "contrast_threshold_off": 0.3795, "refractory_us": 52.0}

# The layouts of Metavision's files, 16 and 24 bytes.
EVENT_DTYPE = np.dtype([("x", "<u2"), ("y", "<u2"), ("p", "<i2"), ("t", "<i8")], align=True)
TRIGGER_DTYPE = np.dtype([("p", "<i2"), ("t", "<i8"), ("id", "<i2")], align=True)
EVENT_KINDS = {"x": np.uint16, "y": np.uint16, "p": np.int8, "t": np.int64}  # in memory
CHUNK = 65536

LARGEST_SIZE = 65536  # pixels that a uint16 coordinate reaches
LARGEST_LED = 255


def read_recording(path: str | Path) -> Recording:
    """Read events.h5.

    Parameters
    ----------
    path : str or Path
        HDF5 file, compressed by any filter that h5py or hdf5plugin knows.

    Returns
    -------
    Recording
        Checked: events in time order and inside the sensor, thresholds positive, a usable schedule.

    Raises
    ------
    InputError
        The file or one of its fields can't be used.

    Warns
    -----
    InputWarning
        A sensor attribute or the crossfade is missing, and its default is taken.
    """
    with open_hdf5(Path(path), "an events.h5") as file:
        width, height = _read_size(file)
        sensor, schedule = _read_sensor(file, width, height), _read_schedule(file)
        events, starts = _read_events(file, width, height), _read_triggers(file)
        return Recording(events, sensor, schedule, starts, str(path))


def write_recording(path: str | Path, recording: Recording) -> None:
    """Write events.h5, compressed by gzip.

    Parameters
    ----------
    path : str or Path
        Where to; an existing file is replaced once the new one is complete.
    recording : Recording
        Thresholds may be numbers or (height, width) arrays.

    Raises
    ------
    InputError
        The file can't be written there.
    ValueError
        A number of the sensor or the schedule is not finite.
    """
    events, sensor, schedule = recording.events, recording.sensor, recording.schedule
    compression = dict(compression="gzip", compression_opts=4, shuffle=True)
    image = io.BytesIO()  # as HDF5 can crash on a full disk
    with h5py.File(image, "w") as file:
        file.attrs["width"], file.attrs["height"] = sensor.width, sensor.height
        kept = dict(chunks=(CHUNK,), maxshape=(None,), **compression)
        table = file.create_dataset("CD/events", len(events), EVENT_DTYPE, **kept)
        for begin in range(0, len(events), PIECE):
            table[begin : begin + PIECE] = _records(events, slice(begin, begin + PIECE))
        if len(recording.round_start_us):
            edges = np.zeros(len(recording.round_start_us), TRIGGER_DTYPE)
            edges["p"], edges["t"] = 1, recording.round_start_us
            file["EXT_TRIGGER/events"] = edges
        group = file.create_group("sensor")
        for name in SENSOR_DEFAULTS:
            value = np.asarray(getattr(sensor, name))
            if value.ndim:
                group.create_dataset(name, data=value.astype(np.float32), **compression)
            group.attrs[name] = _finite(name, value.mean())
        if sensor.contrast_threshold_tolerance:
            group.attrs[TOLERANCE] = _finite(TOLERANCE, sensor.contrast_threshold_tolerance)
        group = file.create_group("schedule")
        group["order"] = np.asarray(schedule.order, np.int32)
        for name in ("slot_us", "crossfade", "start_us"):
            group.attrs[name] = _finite(name, getattr(schedule, name))
        if schedule.trim is not None:
            group["trim"] = np.asarray(schedule.trim, np.float32)
        if schedule.constant_light_on is not None:
            group.attrs["constant_light_on"] = int(schedule.constant_light_on)
    with atomic_path(path) as temporary:
        temporary.write_bytes(image.getvalue())


def _records(events: Events, part: slice) -> np.ndarray:
    """Give some events as records."""
    table = np.zeros(len(events.t[part]), EVENT_DTYPE)
    for name in EVENT_DTYPE.names:
        table[name] = getattr(events, name)[part]
    return table


def _finite(name: str, value: float) -> float:
    if not np.isfinite(value):
        raise ValueError(f"{name} must be finite, got {value}")
    return float(value)


def _read_size(file: h5py.File) -> tuple[int, int]:
    """Read width and height, or the text "1280x720" of `geometry`."""
    geometry = re.search(r"(\d+)x(\d+)", str(file.attrs.get("geometry", "")))
    default = geometry.groups() if geometry else (None, None)
    size = [_number(file, name, default[i]) for i, name in enumerate(("width", "height"))]
    if not all(value in range(1, LARGEST_SIZE + 1) for value in size):
        raise InputError(
            f"attributes width and height are {size[0]:g} and {size[1]:g}; write whole numbers of pixels, "
            f"1 to {LARGEST_SIZE}."
        )
    return int(size[0]), int(size[1])


def _read_events(file: h5py.File, width: int, height: int) -> Events:
    """Read all events piece by piece; they come to lie on disk where memory is short."""
    dataset = _list_of(file, "CD/events", ("x", "y", "p", "t"))
    check_readable(dataset, copies=0)
    n, begins = len(dataset), []
    if n < 2:
        raise InputError(f"CD/events holds {n} events; record again with the ring on, for two at least.")
    events = Events(**columns(n, EVENT_KINDS, f"CD/events of {n} entries"))

    def take(begin: int, part: dict[str, np.ndarray]) -> None:
        x, y = part["x"], part["y"]
        _check_p("CD/events", part["p"], begin)
        outside = (x < 0) | (x >= width) | (y < 0) | (y >= height)
        if outside.any():
            k = outside.argmax()
            raise InputError(
                f"event {begin + k} of CD/events at x={x[k]}, y={y[k]} lies outside the sensor of {width} x {height} "
                "pixels; correct width and height, or crop the events."
            )
        for name in EVENT_KINDS:
            getattr(events, name)[begin : begin + len(x)] = part[name]
        _check_order(part["t"], begin)
        begins.append(begin)

    for_pieces(dataset, take)
    for begin in sorted(begins)[1:]:  # between two pieces
        _check_order(events.t[begin - 1 : begin + 1], begin - 1)
    p = events.p
    if p.min() == p.max():
        raise InputError(
            f"p of CD/events is {int(p[0])} for every event; record both polarities, 1 brighter and 0 darker."
        )
    return events


def _check_order(t: np.ndarray, begin: int) -> None:
    backwards = t[1:] < t[:-1]
    if backwards.any():
        raise InputError(
            f"t of CD/events runs backwards at event {begin + backwards.argmax() + 1}; sort the events by time."
        )


def _read_triggers(file: h5py.File) -> np.ndarray:
    """Read the times of the rising edges, the starts of rounds."""
    name = "EXT_TRIGGER/events"
    if member(file, name) is None:
        return np.empty(0, np.int64)
    table = read_all(_list_of(file, name, ("p", "t")))
    _check_p(name, table["p"])
    start = table["t"][table["p"] == 1].astype(np.int64)
    stands = start[1:] <= start[:-1]
    if stands.any():
        raise InputError(
            f"t of {name} does not grow at round start {stands.argmax() + 1}; "
            "keep one edge with p = 1 per round, in time order."
        )
    if len(table) and not len(start):
        _warn(file, f"{name} has no edge with p = 1, so start_us counts the rounds; swap p if edges fall.")
    return start


def _read_sensor(file: h5py.File, width: int, height: int) -> Sensor:
    group = member(file, "sensor")
    values, missing = {}, []
    for name, default in SENSOR_DEFAULTS.items():
        dataset = member(file, f"sensor/{name}") if name != "refractory_us" else None
        if dataset is not None:
            values[name] = _read_thresholds(dataset, (height, width))
        elif group is not None and name in group.attrs:
            values[name] = _number(group, name)
            if values[name] < 0 or (values[name] == 0 and name != "refractory_us"):
                raise InputError(
                    f"attribute {name} of sensor is {values[name]:g}; write the true one, as {default:g}."
                )
        else:
            values[name] = default
            missing.append(name)
    if missing:
        given = ", ".join(f"{name} ({SENSOR_DEFAULTS[name]:g})" for name in missing)
        _warn(file, f"sensor lacks {given}: these EVK4 values are taken; write the true ones.")
    if group is not None and TOLERANCE in group.attrs:
        values[TOLERANCE] = _number(group, TOLERANCE)
        if values[TOLERANCE] < 0:
            raise InputError(
                f"attribute {TOLERANCE} of sensor is {values[TOLERANCE]:g}; write the true one, as 0.02."
            )
    return Sensor(width, height, **values, guessed=tuple(missing))


def _read_thresholds(dataset: h5py.Dataset, shape: tuple[int, int]) -> np.ndarray:
    name = dataset.name.lstrip("/")
    if not isinstance(dataset, h5py.Dataset) or dataset.dtype.kind not in "fiu" or dataset.shape != shape:
        raise InputError(f"{name} must be an array of (height, width) = {shape} numbers; write it so.")
    threshold = read_all(dataset).astype(np.float32)
    bad = ~(np.isfinite(threshold) & (threshold > 0))
    if bad.any():
        y, x = np.argwhere(bad)[0]
        raise InputError(
            f"{name} is {threshold[y, x]:g} at x={x}, y={y}; thresholds are above 0, so put the median there."
        )
    return threshold


def _read_schedule(file: h5py.File) -> Schedule:
    group = member(file, "schedule")
    if not isinstance(group, h5py.Group):
        raise InputError(
            "the group schedule is missing; write slot_us, crossfade and order there, or join the camera's recording "
            "with the ring's log by python -m evsdr.convert."
        )
    order = member(file, "schedule/order")
    is_list = isinstance(order, h5py.Dataset) and order.ndim == 1 and order.size > 0
    if not is_list or order.dtype.kind not in "iu":
        raise InputError("schedule/order must be a list of integers; write the LED of each slot there.")
    order = read_all(order)
    if order.min() < -1 or not 0 <= order.max() <= LARGEST_LED:
        raise InputError(
            f"schedule/order goes from {order.min()} to {order.max()}; write the LED of each slot, "
            f"0 to {LARGEST_LED}, and -1 where none is lit."
        )
    slot_us = _number(group, "slot_us")
    if slot_us <= 0:
        raise InputError(f"attribute slot_us of schedule is {slot_us:g}; write the length of a slot in us.")
    if "crossfade" not in group.attrs:
        _warn(file, "schedule lacks crossfade: hard switches (0) are taken; write the ring's.")
    crossfade = _number(group, "crossfade", 0.0)
    if not 0 <= crossfade <= 1:
        raise InputError(f"attribute crossfade of schedule is {crossfade:g}; write a fraction, 0 to 1.")
    start_us, constant_light_on = _number(group, "start_us", 0.0), None
    if "constant_light_on" in group.attrs:
        constant_light_on = _number(group, "constant_light_on")
        if constant_light_on not in (0, 1):
            raise InputError(
                f"attribute constant_light_on of schedule is {constant_light_on:g}; write 1 if it was on, else 0."
            )
        constant_light_on = bool(constant_light_on)
    return Schedule(order.astype(np.int32), slot_us, crossfade, start_us, _read_trim(file), constant_light_on)


def _read_trim(file: h5py.File) -> np.ndarray | None:
    item = member(file, "schedule/trim")
    if item is None:
        return None
    if not isinstance(item, h5py.Dataset) or item.ndim != 1 or item.dtype.kind not in "fiu" or not item.size:
        raise InputError("schedule/trim must be a list of numbers; write the brightness of each LED, 0 to 1.")
    trim = read_all(item).astype(np.float32)
    bad = ~((trim >= 0) & (trim <= 1))
    if bad.any():
        led = int(bad.argmax())
        raise InputError(f"schedule/trim of LED {led} is {trim[led]:g}; write its brightness, 0 to 1.")
    return trim


def _list_of(file: h5py.File, name: str, fields: tuple[str, ...]) -> h5py.Dataset:
    """Find a list of records whose fields are integers of any width."""
    dataset = member(file, name)
    if not isinstance(dataset, h5py.Dataset):
        raise InputError(f"the dataset {name} is missing; export the recording with it.")
    dtype = dataset.dtype
    kinds = {"p": "biu"}
    integers = [field for field in dtype.names or () if dtype[field].kind in kinds.get(field, "iu")]
    if dataset.ndim != 1 or not set(fields) <= set(integers):
        raise InputError(f"{name} must be a list of records of integers {', '.join(fields)}; write it so.")
    return dataset


def _check_p(name: str, p: np.ndarray, begin: int = 0) -> None:
    bad = (p != 0) & (p != 1)
    if bad.any():
        k = bad.argmax()
        raise InputError(f"p of {name} is {p[k]} at entry {begin + k}; write 0 or 1.")


def _number(item: h5py.HLObject, name: str, default: object = None) -> float:
    """Read a finite attribute; text that is a number will do."""
    where = f"attribute {name} of {item.name.lstrip('/') or 'the file'}"
    value = item.attrs.get(name, default)
    if value is None:
        raise InputError(f"{where} is missing; write it as a number.")
    try:
        number = float(np.asarray(value).item())
    except (TypeError, ValueError):
        number = np.nan
    if not np.isfinite(number):
        raise InputError(f"{where} is not a finite number; write it as one.")
    return number


def _warn(file: h5py.File, sentence: str) -> None:
    warnings.warn(InputWarning(f"{file.filename}: {sentence}"), stacklevel=4)
