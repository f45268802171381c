"""Encoders of camera files for the tests: EVT 2.0, EVT 2.1, EVT 3.0, and Metavision HDF5 with ECF."""

import h5py
import numpy as np

from evsdr.files.events_h5 import EVENT_DTYPE, TRIGGER_DTYPE
from evsdr.records import Events
from evsdr.rig.camera_file import CameraRecording, Edges

WIDTH, HEIGHT = 64, 48


def make_recording(
    x, y, p, t, edge_p=(), edge_t=(), edge_id=(), width=WIDTH, height=HEIGHT
) -> CameraRecording:
    """Give a recording from lists."""
    events = Events(np.asarray(x, "u2"), np.asarray(y, "u2"), np.asarray(p, "i1"), np.asarray(t, "i8"))
    edges = Edges(np.asarray(edge_p, "i1"), np.asarray(edge_t, "i8"), np.asarray(edge_id, "i2"))
    return CameraRecording(width, height, events, edges)


def random_recording(
    rng, n_event, n_edge, duration_us=1_000_000, start_us=5000, width=WIDTH, height=HEIGHT
) -> CameraRecording:
    """Give random events, one half alone and the other in rows of one time, so that masks hold several.

    Within a time the events are in the order in which the vector formats tell them: row, polarity, column.
    """
    n_lone, n_row = n_event // 2, n_event // 16
    t, y, p = (
        np.concatenate([rng.integers(0, most, n_lone), np.repeat(rng.integers(0, most, n_row), 8)])
        for most in (duration_us, height, 2)
    )
    x = np.concatenate([rng.integers(0, width, n_lone), *(rng.permutation(64)[:8] for _ in range(n_row))])
    unique = np.unique(np.stack([t, y, p, x]), axis=1)
    edge_t = np.sort(rng.integers(0, duration_us, n_edge))
    edges = rng.integers(0, 2, n_edge), edge_t + start_us, rng.integers(0, 8, n_edge)
    return make_recording(unique[3], unique[1], unique[2], unique[0] + start_us, *edges, width, height)


# ---- EVT -------------------------------------------------------------------------------------------------


def encode_raw(camera: CameraRecording, kind: str) -> bytes:
    """Give the bytes of a RAW file; kind is EVT2, EVT21, EVT21 legacy or EVT3."""
    name, _, legacy = kind.partition(" ")
    endianness = f";endianness={legacy or 'little'}" if name == "EVT21" else ""
    header = f"% evt x\n% format {name};height={camera.height};width={camera.width}{endianness}\n% end\n"
    words = _encode_evt3(camera) if name == "EVT3" else _encode_evt2(camera, name == "EVT21")
    words = np.array(words, {"EVT2": "<u4", "EVT21": "<u8", "EVT3": "<u2"}[name])
    if legacy:
        words = (words >> np.uint64(32)) | (words << np.uint64(32))
    return header.encode() + words.tobytes()


def _in_time_order(camera: CameraRecording) -> list[tuple]:
    """Give groups (t, y, p, [x ...]) and edges (t, id, value), merged by time."""
    groups: dict[tuple, list] = {}
    events, edges = camera.events, camera.edges
    for t, y, p, x in zip(*(a.tolist() for a in (events.t, events.y, events.p, events.x)), strict=True):
        groups.setdefault((t, y, p), []).append(x)
    items = [(t, 0, y, p, x) for (t, y, p), x in groups.items()]
    items += [
        (t, 1, i, p, []) for t, i, p in zip(*(a.tolist() for a in (edges.t, edges.id, edges.p)), strict=True)
    ]
    return sorted(items, key=lambda item: item[:2])


def _encode_evt2(camera: CameraRecording, vector: bool) -> list[int]:
    words, high = [], None
    shift = 32 if vector else 0

    def put(word: int, mask: int = 0) -> None:
        words.append(word << shift | mask)

    for t, is_edge, y, p, columns in _in_time_order(camera):
        if high is None or t >> 6 != high:
            high = t >> 6
            put(0x8 << 28 | high % (1 << 28))
        low = (t & 63) << 22
        if is_edge:
            put(0xA << 28 | low | y << 8 | p)
        elif not vector:
            for x in columns:
                put(p << 28 | low | x << 11 | y)
        else:
            for base in sorted({x // 32 * 32 for x in columns}):
                mask = sum(1 << (x - base) for x in columns if x // 32 * 32 == base)
                put(p << 28 | low | base << 11 | y, mask)
    return words


TYPES = {
    "y": 0x0,
    "x": 0x2,
    "base": 0x3,
    "mask 12": 0x4,
    "mask 8": 0x5,
    "low": 0x6,
    "high": 0x8,
    "trigger": 0xA,
}


def _encode_evt3(camera: CameraRecording) -> list[int]:
    words, high, low, row = [], None, None, None

    def put(kind: str, content: int) -> None:
        words.append(TYPES[kind] << 12 | content)

    for t, is_edge, y, p, columns in _in_time_order(camera):
        for step in range(t >> 12, (t >> 12) + 1) if high is None else range(high + 1, (t >> 12) + 1):
            put("high", step & 0xFFF)
            high, low = step, None
        if t & 0xFFF != low:
            low = t & 0xFFF
            put("low", low)
        if is_edge:
            put("trigger", y << 8 | p)
            words.extend([0xE014, 0xF123, 0x7004])  # a count of events, to be skipped
            continue
        if y != row:
            row = y
            put("y", row)
        if len(columns) == 1:
            put("x", p << 11 | columns[0])
            continue
        for base in sorted({x // 32 * 32 for x in columns}):
            mask = sum(1 << (x - base) for x in columns if x // 32 * 32 == base)
            put("base", p << 11 | base)
            put("mask 12", mask & 0xFFF)
            put("mask 12", mask >> 12 & 0xFFF)
            put("mask 8", mask >> 24)
    return words


# ---- Metavision HDF5 -------------------------------------------------------------------------------------


def encode_ecf(table: np.ndarray, style: int) -> bytes:
    """Pack records x, y, p, t into a chunk; style 2 packs y, x and p, 1 packs x and p, 0 nothing."""
    n = len(table)
    out = bytearray(np.uint32(n << 2 | style).tobytes() + np.uint64(table["t"][0]).tobytes())
    now = int(table["t"][0])
    for t, length in _runs(table["t"]):
        step, now = t - now, t
        if step >= 15:
            while step:
                out.append(0xF0 | step & 15)
                step >>= 4
        out += bytes([step << 4 | min(length, 15)]) + (length.to_bytes(2, "little") if length >= 15 else b"")
    x, y, p = (np.r_[table[name].astype(int), [0] * 8] for name in "xyp")
    if style == 2:
        packed = (y << 12 | x << 1 | p)[: -(-n // 4) * 4].reshape(-1, 4).T
        a, b, c, d = packed
        out += (
            np.stack([a << 8 | b & 255, b >> 8 << 16 | c & 0xFFFF, c >> 16 << 24 | d], 1)
            .astype("<u4")
            .tobytes()
        )
        return bytes(out)
    for value, length in _runs(table["y"]):
        words = [value << 5 | min(length, 31)] + ([length] if length >= 31 else [])
        out += np.array(words, "<u2").tobytes()
    if style == 1:
        a, b, c, d = (x << 1 | p)[: -(-n // 4) * 4].reshape(-1, 4).T
        out += np.stack([a << 4 | b & 15, b >> 4 << 8 | c & 255, c >> 8 << 12 | d], 1).astype("<u2").tobytes()
        return bytes(out)
    i = 0
    while i < n:
        first, mask, i = x[i], 0, i + 1
        while i < n and first < x[i] <= first + 5 and not mask & (1 << (first + 6 - x[i])) - 1:
            mask, i = mask | 1 << (first + 5 - x[i]), i + 1
        out += np.uint16(first << 5 | mask).tobytes()
    for value, length in _runs(table["p"]):
        out += bytes([value << 7 | min(length, 127)]) + (
            length.to_bytes(2, "little") if length >= 127 else b""
        )
    return bytes(out)


def _runs(values: np.ndarray) -> list[tuple[int, int]]:
    starts = np.r_[0, np.flatnonzero(np.diff(values)) + 1, len(values)]
    return [(int(values[a]), int(b - a)) for a, b in zip(starts, starts[1:])]


def write_metavision(path, camera: CameraRecording, style: int, chunk: int = 1000) -> None:
    """Write a HDF5 file as Metavision does; style 3 stores each chunk as it is."""
    table = np.zeros(len(camera.events), EVENT_DTYPE)
    for name in EVENT_DTYPE.names:
        table[name] = getattr(camera.events, name)
    edges = np.zeros(len(camera.edges), TRIGGER_DTYPE)
    for name in TRIGGER_DTYPE.names:
        edges[name] = getattr(camera.edges, name)
    with h5py.File(path, "w") as file:
        file.attrs["geometry"] = f"{camera.width}x{camera.height}"
        file.create_group("CD")
        properties = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        properties.set_chunk((chunk,))
        properties.set_filter(0x8ECF, h5py.h5z.FLAG_OPTIONAL)
        kind, space = (
            h5py.h5t.py_create(EVENT_DTYPE),
            h5py.h5s.create_simple((len(table),), (h5py.h5s.UNLIMITED,)),
        )
        dataset = h5py.h5d.create(file["CD"].id, b"events", kind, space, dcpl=properties)
        for start in range(0, len(table), chunk):
            part = table[start : start + chunk]
            if style == 3:
                dataset.write_direct_chunk((start,), part.tobytes(), filter_mask=1)
            else:
                dataset.write_direct_chunk((start,), encode_ecf(part, style))
        file["EXT_TRIGGER/events"] = edges


def assert_same(read, camera):
    """Check that two recordings of a camera are equal."""
    for name in ("x", "y", "p", "t"):
        np.testing.assert_array_equal(getattr(read.events, name), getattr(camera.events, name), name)
    for name in ("p", "t", "id"):
        np.testing.assert_array_equal(getattr(read.edges, name), getattr(camera.edges, name), name)
    assert (read.width, read.height) == (camera.width, camera.height)
