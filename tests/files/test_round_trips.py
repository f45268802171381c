"""Whatever is written is read back the same."""

import numpy as np
import OpenEXR
import png
from hypothesis import given
from hypothesis import strategies as st

from evsdr.files.events_h5 import read_recording, write_recording
from evsdr.files.mask import read_mask
from evsdr.files.results import encode_normal, write_exr, write_png
from evsdr.records import Events, Recording, Schedule, Sensor

seeds = st.integers(0, 2**32 - 1)
times = st.floats(1e-3, 1e6)


@given(
    seed=seeds,
    width=st.integers(1, 65536),
    height=st.integers(1, 300),
    n_event=st.integers(2, 40),
    start=st.integers(0, 2**50),
    order=st.lists(st.integers(-1, 255), min_size=1, max_size=30).filter(lambda order: max(order) >= 0),
    n_round=st.integers(0, 4),
    slot_us=times,
    crossfade=st.floats(0, 1),
    refractory_us=st.floats(0, 1e4),
    start_us=st.floats(-1e12, 1e12),
    per_pixel=st.booleans(),
)
def test_recordings(tmp_path, seed, width, height, n_event, start, order, n_round, per_pixel, **numbers):
    rng, width = np.random.default_rng(seed), min(width, 100) if per_pixel else width
    p = rng.integers(0, 2, n_event).astype(np.int8)
    p[:2] = 0, 1
    events = Events(
        rng.integers(0, width, n_event).astype(np.uint16),
        rng.integers(0, height, n_event).astype(np.uint16),
        p,
        np.sort(rng.integers(start, start + 10**6, n_event)),
    )
    on, off = rng.uniform(0.01, 2, (2, height, width) if per_pixel else 2).astype(np.float32)
    if not per_pixel:
        on, off = float(on), float(off)
    sensor = Sensor(width, height, on, off, numbers.pop("refractory_us"))
    schedule = Schedule(np.array(order, np.int32), **numbers)
    starts = start + np.cumsum(rng.integers(1, 10**6, n_round))
    path = tmp_path / "events.h5"
    write_recording(path, Recording(events, sensor, schedule, starts))
    read = read_recording(path)
    for name in ("x", "y", "p", "t"):
        np.testing.assert_array_equal(getattr(read.events, name), getattr(events, name))
    for name in ("width", "height", "contrast_threshold_on", "contrast_threshold_off", "refractory_us"):
        np.testing.assert_array_equal(getattr(read.sensor, name), getattr(sensor, name))
    for name in ("order", "slot_us", "crossfade", "start_us"):
        np.testing.assert_array_equal(getattr(read.schedule, name), getattr(schedule, name))
    np.testing.assert_array_equal(read.round_start_us, starts)
    assert read.sensor.guessed == ()


def random_normals(seed, height, width):
    normal = np.random.default_rng(seed).normal(size=(height, width, 3))
    normal[..., 2] = np.abs(normal[..., 2])
    return (normal / np.linalg.norm(normal, axis=-1, keepdims=True)).astype(np.float32)


@given(seed=seeds, height=st.integers(1, 9), width=st.integers(1, 9))
def test_normals_as_pictures(tmp_path, seed, height, width):
    """A float EXR keeps them to the bit, a 16-bit PNG to half a step."""
    normal = random_normals(seed, height, width)
    mask = np.random.default_rng(seed).random((height, width)) < 0.7
    write_exr(tmp_path / "normal.exr", {"RGB": normal})
    with OpenEXR.File(str(tmp_path / "normal.exr")) as file:
        np.testing.assert_array_equal(file.channels()["RGB"].pixels, normal)
    write_png(tmp_path / "normal.png", encode_normal(normal, mask))
    _, _, rows, info = png.Reader(bytes=(tmp_path / "normal.png").read_bytes()).read()
    decoded = np.vstack([np.asarray(row) for row in rows]).reshape(height, width, 3) / 65535 * 2 - 1
    assert info["bitdepth"] == 16
    np.testing.assert_allclose(decoded[mask], normal[mask], rtol=0, atol=1.001 / 65535)
    np.testing.assert_allclose(decoded[~mask], np.tile([0, 0, 1], ((~mask).sum(), 1)), atol=1.001 / 65535)


@given(seed=seeds, height=st.integers(1, 9), width=st.integers(1, 9), kind=st.sampled_from(("npy", 1, 8, 16)))
def test_masks(tmp_path, seed, height, width, kind):
    mask = np.random.default_rng(seed).random((height, width)) < 0.5
    path = tmp_path / ("mask.npy" if kind == "npy" else "mask.png")
    if kind == "npy":
        np.save(path, mask)
    else:
        with open(path, "wb") as file:
            png.Writer(width, height, greyscale=True, bitdepth=kind).write(file, mask.astype(int).tolist())
    np.testing.assert_array_equal(read_mask(path, (height, width)), mask)
