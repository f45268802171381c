"""Spoil files: their bytes, the words of a text, or the items of an HDF5 file."""

import re
from pathlib import Path

import h5py
import numpy as np

NUMBER = re.compile(rb"[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?")
WORDS = (
    *(b"nan", b"inf", b"-inf", b"1e400", b"1e-400", b"0", b"-1", b"1e9", b"2147483648", b"9" * 400, b"", b"null"),
    *(b"true", b"[]", b"{}", b"\x00", b"\xff", b"..", b"/dev/zero", b"\"", b"<", b">", b"\n", b",", b"$x", b"99999"),
)  # fmt: skip
VALUES = (
    np.nan,
    np.inf,
    -np.inf,
    0,
    -1,
    1e300,
    1e-300,
    2**63 - 1,
    -(2**63),
    b"text",
    "text",
    [],
    [1, 2],
    [[0.5]],
)
ENDS = (0, 1, 0x7F, 0x80, 0xFF)


def spoil_bytes(data: bytes, rng: np.random.Generator) -> bytes:
    """Change some bytes, cut some out, repeat some, or end early."""
    out = bytearray(data)
    for _ in range(1 + rng.integers(4)):
        if not out:
            return bytes(out)
        at, n = int(rng.integers(len(out))), int(rng.integers(1, 9))
        kind = rng.integers(6)
        if kind == 0:
            out[at] ^= 1 << int(rng.integers(8))
        elif kind == 1:
            out[at : at + n] = bytes(rng.integers(0, 256, n, np.uint8))
        elif kind == 2:
            out[at : at + n] = bytes([ENDS[rng.integers(len(ENDS))]]) * n
        elif kind == 3:
            del out[at : at + int(rng.integers(1, 1 + len(out)))]
        elif kind == 4:
            out[at:at] = out[at : at + int(rng.integers(1, 200))]
        else:
            del out[at:]
    return bytes(out)


def spoil_text(data: bytes, rng: np.random.Generator) -> bytes:
    """Change a number or another word, drop or repeat a line or a piece, or spoil bytes."""
    kind = rng.integers(6)
    if kind == 0:
        return spoil_bytes(data, rng)
    if kind == 1:
        lines = data.splitlines(keepends=True)
        at, to = rng.integers(len(lines), size=2)
        return b"".join([*lines[:at], *([lines[to]] * int(rng.integers(3))), *lines[at + 1 :]])
    found = list((NUMBER if kind < 5 else re.compile(rb"[A-Za-z_]+")).finditer(data))
    if not found:
        return spoil_bytes(data, rng)
    match = found[rng.integers(len(found))]
    word = WORDS[rng.integers(len(WORDS))]
    if kind == 5 and rng.integers(2):
        word = found[rng.integers(len(found))][0]  # one word in the place of another
    return data[: match.start()] + word + data[match.end() :]


def spoil_hdf5(path: Path, rng: np.random.Generator) -> None:
    """Change attributes and datasets of an HDF5 file, or its bytes."""
    if rng.integers(3) == 0:
        path.write_bytes(spoil_bytes(path.read_bytes(), rng))
        return
    with h5py.File(path, "r+") as file:
        names: list[str] = []
        file.visit(names.append)
        item = file[["/", *names][rng.integers(1 + len(names))]]
        if len(item.attrs) and rng.integers(2):
            name = list(item.attrs)[rng.integers(len(item.attrs))]
            item.attrs[name] = VALUES[rng.integers(len(VALUES))]
        elif isinstance(item, h5py.Dataset):
            _spoil_dataset(file, item, rng)
        elif names:
            del file[names[rng.integers(len(names))]]


def _spoil_dataset(file: h5py.File, item: h5py.Dataset, rng: np.random.Generator) -> None:
    table, name, kind = item[()], item.name, rng.integers(5)
    if item.dtype.names and kind < 3 and item.size:
        field = item.dtype.names[rng.integers(len(item.dtype.names))]
        some = rng.random(len(table)) < rng.choice([0.01, 0.5, 1.0])
        most = np.iinfo(table[field].dtype)
        table[field][some] = rng.choice([most.min, most.max, 0, 1, -1 if most.min else 3])
    elif kind < 3 and item.size:
        table = np.array(table, float)
        table.flat[rng.integers(table.size)] = rng.choice([np.nan, np.inf, 0.0, -1.0, 1e300])
    elif kind == 3:
        table = table[: rng.integers(1 + len(table))] if item.ndim else np.zeros(0)
    else:
        table = rng.choice([0, 1], (3, 2)) if rng.integers(2) else np.bytes_(b"text")
    del file[name]
    file[name] = table
