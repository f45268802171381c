"""A small recording, and how to spoil its file."""

import h5py
import numpy as np

from evsdr.records import Events, Recording, Schedule, Sensor

WIDTH, HEIGHT, N_EVENT = 12, 7, 500


def small_recording() -> Recording:
    """Give random events of a sensor whose ON thresholds differ."""
    rng = np.random.default_rng(0)
    events = Events(
        x=rng.integers(0, WIDTH, N_EVENT).astype(np.uint16),
        y=rng.integers(0, HEIGHT, N_EVENT).astype(np.uint16),
        p=rng.integers(0, 2, N_EVENT).astype(np.int8),
        t=np.sort(rng.integers(0, 50_000, N_EVENT)) + 2**40,
    )
    on = rng.uniform(0.2, 0.3, (HEIGHT, WIDTH)).astype(np.float32)
    sensor = Sensor(WIDTH, HEIGHT, on, 0.31, 17.5)
    trim = np.array([0.5, 1, 0], np.float32)
    schedule = Schedule(np.array([2, -1, 0, 1], np.int32), 2500.0, 0.25, 12.5, trim, False)
    return Recording(events, sensor, schedule, 2**40 + np.arange(5) * 10_001)


def change(path, name, change_table):
    """Replace the dataset `name` by change_table(dataset as array)."""
    with h5py.File(path, "r+") as file:
        table = change_table(file[name][()])
        del file[name]
        if table is not None:
            file[name] = table


def set_field(field, index, value):
    def change_table(table):
        table[field][index] = value
        return table

    return change_table


def set_attribute(path, group, name, value):
    with h5py.File(path, "r+") as file:
        if value is None:
            del file[group].attrs[name]
        else:
            file[group].attrs[name] = value
