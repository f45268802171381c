"""Writers of other people's recordings for the tests: EventPS, DSEC and AEDAT4."""

import lzma
import struct

import h5py
import numpy as np

from evsdr.rig.camera_file import CameraRecording


def write_eventps(path, camera: CameraRecording) -> None:
    """Pack float32 records row, column, polarity, seconds."""
    events = camera.events
    table = np.stack([events.y, events.x, 2.0 * events.p - 1, 1e-6 * events.t], axis=1)
    path.write_bytes(lzma.compress(table.astype("<f4").tobytes(), preset=0))


def write_eventps_triggers(path, t_us) -> None:
    """Pack float32 seconds."""
    path.write_bytes(lzma.compress((1e-6 * np.asarray(t_us)).astype("<f4").tobytes(), preset=0))


def write_dsec(path, camera: CameraRecording, offset_us: int) -> None:
    """Write columns of events, with times from an offset on."""
    events = camera.events
    with h5py.File(path, "w") as file:
        for name, kind in (("x", "u2"), ("y", "u2"), ("p", "u1"), ("t", "u4")):
            values = getattr(events, name) - (offset_us if name == "t" else 0)
            file[f"events/{name}"] = values.astype(kind)
        file["ms_to_idx"], file["t_offset"] = np.zeros(3, np.uint64), np.int64(offset_us)


# ---- AEDAT4: flat buffers, see https://docs.inivation.com and google.github.io/flatbuffers ----------------


def write_aedat(path, camera: CameraRecording) -> None:
    """Write a stream of events and one of triggers, packed by nothing."""
    events, edges = camera.events, camera.edges
    info = '<dv version="2.0"><node name="outInfo" path="/mainloop/Recorder/outInfo/">'
    for i, kind in enumerate(("EVTS", "TRIG")):
        info += f'<node name="{i}" path="/mainloop/Recorder/outInfo/{i}/">'
        info += f'<attr key="compression" type="string">NONE</attr><attr key="typeIdentifier" type="string">{kind}</attr>'
        info += f'<node name="info" path="/mainloop/Recorder/outInfo/{i}/info/">'
        info += f'<attr key="sizeX" type="int">{camera.width}</attr><attr key="sizeY" type="int">{camera.height}</attr>'
        info += "</node></node>"
    info += "</node></dv>"
    text = struct.pack("<I", len(info)) + info.encode() + b"\0"
    header = _table("IOHE", struct.pack("<iqI", 0, -1, 4), (4, 8, 16), text)
    table = np.zeros(
        len(events), np.dtype([("t", "<i8"), ("x", "<i2"), ("y", "<i2"), ("p", "?"), ("_", "V3")])
    )
    for name in "txyp":
        table[name] = getattr(events, name)
    packets = [
        (0, _table("EVTS", struct.pack("<I", 4), (4,), struct.pack("<I", len(table)) + table.tobytes()))
    ]
    packets.append((1, _triggers(edges)))
    data = b"".join(struct.pack("<ii", stream, len(packet)) + packet for stream, packet in packets)
    path.write_bytes(b"#!AER-DAT4.0\r\n" + header + data)


def _table(identifier: str, fields: bytes, places: tuple[int, ...], vector: bytes) -> bytes:
    """Give a buffer, size first, whose root has fields, the last of them the offset of what follows it."""
    vtable = struct.pack(f"<{2 + len(places)}H", 4 + 2 * len(places), 4 + len(fields), *places)
    vtable += bytes(-len(vtable) % 8 + 4)  # fields of 8 bytes, and elements of vectors, are aligned to 8
    at = 8 + len(vtable)
    body = struct.pack("<I", at) + identifier.encode() + vtable + struct.pack("<i", len(vtable)) + fields
    body += vector
    return struct.pack("<I", len(body)) + body


def _triggers(edges) -> bytes:
    """Give a packet of triggers; each is a table of its own, time and source."""
    n = len(edges)
    vtable = struct.pack("<4H", 8, 16, 4, 12)
    start = 4 + 4 * n  # of the shared vtable, from the length of the vector on
    offsets, tables = b"", b""
    for k, (t, p) in enumerate(zip(edges.t.tolist(), edges.p.tolist())):
        place = start + len(vtable) + 16 * k
        offsets += struct.pack("<I", place - (4 + 4 * k))
        tables += struct.pack("<iqB3x", place - start, t, 1 if p else 2)
    return _table("TRIG", struct.pack("<I", 4), (4,), struct.pack("<I", n) + offsets + vtable + tables)
