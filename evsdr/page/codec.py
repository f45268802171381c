"""Arrays inside a page: quantised, as differences of neighbours, deflated, in base64.

A layer holds values (n, n_channel) of the pixels that are stored, row after row. Each value v becomes an integer

    q = round((f(v) - low) / (high - low) * (2^bits - 1)),

with f the identity (`linear`), the natural logarithm (`log`), or asinh(v / unit) (`asinh`), and low and high the extremes
of f. What is deflated (zlib) are the differences of q from one pixel to the next modulo 2^bits, channel after channel; of
16 bits first all low bytes, then all high ones. `decode.js` undoes it in the page, `unpack` here.
"""

import base64
import zlib
from dataclasses import dataclass

import numpy as np

LEVEL = 4  # of zlib: 6 takes half as long again and saves a percent
SMALLEST = 1e-12  # below which a logarithm is not asked for
FORWARD = {
    "linear": lambda v, unit: v,
    "log": lambda v, unit: np.log(np.maximum(v, SMALLEST)),
    "asinh": lambda v, unit: np.arcsinh(v / unit),
}
BACKWARD = {
    "linear": lambda f, unit: f,
    "log": lambda f, unit: np.exp(f),
    "asinh": lambda f, unit: unit * np.sinh(f),
}


@dataclass(frozen=True)
class Layer:
    """An array as a page holds it.

    Attributes
    ----------
    bits : int
        8 or 16.
    scale : str
        `linear`, `log` or `asinh`.
    unit : float
        Of asinh.
    low, high : float
        Extremes of f(v).
    n_channel : int
    data : str
        Base64.
    """

    bits: int
    scale: str
    unit: float
    low: float
    high: float
    n_channel: int
    data: str

    @property
    def step(self) -> float:
        """Half a step of q, in f(v): the largest error."""
        return 0.5 * (self.high - self.low) / (2**self.bits - 1)


def pack(
    values: np.ndarray,
    bits: int = 16,
    scale: str = "linear",
    unit: float = 1.0,
    extremes: tuple[float, float] | None = None,
) -> Layer:
    """Pack values (n,) or (n, n_channel), all finite; `extremes` of f(v) are those of the values by default."""
    values = np.asarray(values, np.float64)
    f = FORWARD[scale](values[None] if values.ndim == 1 else values.T, unit)
    if not np.isfinite(f).all():
        raise ValueError("a page holds finite values only")
    low, high = extremes or ((float(f.min()), float(f.max())) if f.size else (0.0, 0.0))
    top = 2**bits - 1
    q = np.round((np.clip(f, low, high) - low) * (top / (high - low))) if high > low else np.zeros_like(f)
    kind = np.uint8 if bits == 8 else np.uint16
    difference = np.diff(q.astype(kind), axis=1, prepend=kind(0))  # wraps around
    planes = [difference & 0xFF, difference >> 8] if bits == 16 else [difference]
    raw = b"".join(plane.astype(np.uint8).tobytes() for plane in planes)
    data = base64.b64encode(zlib.compress(raw, LEVEL)).decode("ascii")
    return Layer(bits, scale, unit, low, high, len(f), data)


def unpack(layer: Layer) -> np.ndarray:
    """Give the values (n, n_channel) float64 that a page shows."""
    raw = np.frombuffer(zlib.decompress(base64.b64decode(layer.data)), np.uint8)
    planes = raw.reshape(layer.bits // 8, layer.n_channel, -1).astype(np.uint16)
    difference = planes[0] | (planes[1] << 8) if layer.bits == 16 else planes[0]
    q = np.cumsum(difference, axis=1, dtype=np.uint64) & np.uint64(2**layer.bits - 1)
    f = layer.low + q.astype(np.float64) * ((layer.high - layer.low) / (2**layer.bits - 1))
    return BACKWARD[layer.scale](f, layer.unit).T
