"""The container of glTF 2.0: JSON and bytes in one file (Khronos 2021, glTF 2.0 specification, section 4)."""

import json
import struct
from pathlib import Path

import numpy as np

FLOAT, UINT32 = 5126, 5125  # componentType
ARRAY, ELEMENTS = 34962, 34963  # target of a buffer view
KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}


class Buffer:
    """Bytes of a glTF file, with the views and accessors that tell what they are."""

    def __init__(self):
        self.data, self.views, self.accessors = bytearray(), [], []

    def view(self, data: bytes, **about) -> int:
        """Append bytes; gives the index of their view."""
        self.views.append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)} | about)
        self.data += data + bytes(-len(data) % 4)
        return len(self.views) - 1

    def attribute(self, values: np.ndarray) -> int:
        """Append a value (n, 2 to 4) for each vertex; gives the index of the accessor."""
        values = np.ascontiguousarray(values, "<f4")
        about = {
            "bufferView": self.view(values.tobytes(), target=ARRAY),
            "componentType": FLOAT,
            "count": len(values),
            "type": KINDS[values.shape[1]],
            "min": values.min(axis=0).tolist(),
            "max": values.max(axis=0).tolist(),
        }
        self.accessors.append(about)
        return len(self.accessors) - 1

    def corners(self, face: np.ndarray) -> int:
        """Append the corners (n, 3) of triangles; gives the index of the accessor."""
        view = self.view(np.ascontiguousarray(face, "<u4").tobytes(), target=ELEMENTS)
        self.accessors.append(
            {"bufferView": view, "componentType": UINT32, "count": face.size, "type": "SCALAR"}
        )
        return len(self.accessors) - 1


def write_glb(path: Path, document: dict, buffer: Buffer) -> None:
    """Write a document and its buffer into one file."""
    whole = document | {
        "buffers": [{"byteLength": len(buffer.data)}],
        "bufferViews": buffer.views,
        "accessors": buffer.accessors,
    }
    text = json.dumps(whole, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    chunks = [(b"JSON", text), (b"BIN\0", bytes(buffer.data))]
    body = b"".join(struct.pack("<I4s", len(data), kind) + data for kind, data in chunks)
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body)
