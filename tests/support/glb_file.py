"""A reader of .glb as the specification tells, for tests."""

import json
import struct

import numpy as np

WIDTH = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
KIND = {5126: "<f4", 5125: "<u4"}


def read_glb(path):
    """Give the document and the bytes of its buffer."""
    data = path.read_bytes()
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    chunks, at = {}, 12
    while at < length:
        size, kind = struct.unpack_from("<I4s", data, at)
        assert size % 4 == 0
        chunks[kind] = data[at + 8 : at + 8 + size]
        at += 8 + size
    return json.loads(chunks[b"JSON"]), chunks[b"BIN\0"]


def accessor(document, data, index):
    """Give the values of an accessor."""
    told = document["accessors"][index]
    view = document["bufferViews"][told["bufferView"]]
    n = WIDTH[told["type"]]
    part = data[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
    return np.frombuffer(part, KIND[told["componentType"]]).reshape(told["count"], n)
