"""What a page shows of a fit, as numbers: layers of the pixels that are stored, and what goes with them.

The largest layers are left out where the page would become too large: `left_out` names them.
"""

from collections.abc import Iterator
from dataclasses import asdict

import numpy as np

from evsdr.files.daylight import daylight_weights, read_table
from evsdr.metrics import angular_error_deg
from evsdr.page.codec import Layer, pack
from evsdr.records import Maps, Signals, Truth
from evsdr.shape.depth import Depth

FORMAT = "evsdr report 1"
MOST_BYTES = 28 << 20  # of all layers: a page of 30 MB opens on a phone; guessed
MOST_DEEP = 12_000_000  # reflectances (pixel, band) that are stored with 16 bits; with more, 8
SOLVED, KNOWN, SCALED, TRUE, DEEP = 1, 2, 4, 8, 16  # bits of the layer `state`
CHANGE_UNIT = (
    0.05  # of asinh: changes of log light are stored to about a fortieth of it near 0, and up to e^3
)
MOST_CHANGE = 3.0
LEAST_SIGMA = 1e-4  # of a change, or a reflectance
DIMMEST = 1e-3  # of the strongest wavelength: what the eye hardly sees has no colour

Packed = tuple[str, np.ndarray, dict]  # name, values of the stored pixels, arguments of `pack`


def contents(
    maps: Maps,
    signals: Signals | None = None,
    depth: Depth | None = None,
    truth: Truth | None = None,
    most_bytes: int = MOST_BYTES,
) -> dict:
    """Collect what the scripts of a page read; plain numbers, texts, lists and dicts.

    Parameters
    ----------
    maps : Maps
    signals : Signals, optional
        Light of each LED.
    depth : Depth, optional
        Of the pixels solved.
    truth : Truth, optional
        What is true.
    most_bytes : int
        Layers are left out, the least important first, where they would need more.
    """
    stored = stored_pixels(maps, signals, depth)
    layers, left_out, room = {"state": state(maps, stored, depth, truth)}, [], most_bytes
    for name, values, how in wanted(maps, stored, signals, depth, truth):
        layer = pack(values, **how) if values.size * how.get("bits", 16) / 8 < 2 * room else None
        if layer is None or len(layer.data) > room:
            left_out.append(name)
            continue
        layers[name] = layer
        room -= len(layer.data)
    height, width = maps.mask.shape
    return {
        "format": FORMAT,
        "height": height,
        "width": width,
        "wavelength_nm": numbers(maps.band_wavelength_nm),
        "daylight": numbers(daylight_weights(maps.band_wavelength_nm)),
        "band_colour": numbers(band_colours(maps.band_wavelength_nm)),
        "leds": ring(signals),
        "camera": camera(depth),
        "left_out": left_out,
        "layers": {name: asdict(layer) for name, layer in layers.items()},
    }


def stored_pixels(maps: Maps, signals: Signals | None, depth: Depth | None) -> np.ndarray:
    """Tell which pixels (H, W) have values in the layers: those that were solved."""
    stored = maps.mask | maps.mask_reflectance
    if depth is not None:
        stored = stored | depth.mask
    if signals is not None:
        stored.ravel()[signals.pixel] = True
    return stored


def state(maps: Maps, stored: np.ndarray, depth: Depth | None, truth: Truth | None) -> Layer:
    """Pack what is known of each pixel of the whole film: bits of SOLVED, KNOWN, SCALED, TRUE, DEEP."""
    bits = SOLVED * stored + KNOWN * maps.mask + SCALED * maps.mask_reflectance
    if truth is not None:
        bits = bits + TRUE * (truth.mask & stored)
    if depth is not None:
        bits = bits + DEEP * (depth.mask & maps.mask)
    return pack(bits.ravel(), bits=8, extremes=(0, 255))


def wanted(
    maps: Maps, stored: np.ndarray, signals: Signals | None, depth: Depth | None, truth: Truth | None
) -> Iterator[Packed]:
    """Give all layers, the most important first."""
    reflectance = maps.reflectance[stored]
    yield "normal", maps.normal[stored], {"extremes": (-1, 1)}
    yield "reflectance", reflectance, {"bits": 16 if reflectance.size <= MOST_DEEP else 8}
    yield "normal_sigma_deg", maps.normal_sigma_deg[stored], {"scale": "log"}
    if depth is not None:
        known = depth.mask & maps.mask
        middle = depth.depth[known].mean() if known.any() else 0.0
        yield "depth", np.where(known, depth.depth, middle)[stored], {}
        yield "ties", ties(depth)[stored], {"bits": 8, "extremes": (0, 255)}
    if truth is not None:
        yield from errors(maps, truth, stored)
    if signals is not None:
        yield "residual", laid_out(signals, signals.residual, stored), {}
        count = np.minimum(laid_out(signals, signals.count, stored), 65535)
        yield "events", count, {"extremes": (0, 65535)}
    logs = {"bits": 8, "scale": "log"}
    yield "reflectance_sigma", np.maximum(maps.reflectance_sigma[stored], LEAST_SIGMA), logs
    if signals is not None:
        bound = np.arcsinh(MOST_CHANGE / CHANGE_UNIT)
        change = {"bits": 8, "scale": "asinh", "unit": CHANGE_UNIT, "extremes": (-bound, bound)}
        yield "light", laid_out(signals, signals.modelled, stored), {"scale": "log"}
        yield "change", laid_out(signals, signals.change, stored), change
        sigma = np.maximum(laid_out(signals, signals.sigma, stored), LEAST_SIGMA)
        yield "change_sigma", sigma, logs | {"extremes": (np.log(LEAST_SIGMA), 0.0)}


def ties(depth: Depth) -> np.ndarray:
    """Give which neighbours lie on one surface, (H, W): 1 that on the right, 2 that below."""
    out = np.zeros(depth.mask.shape, np.uint8)
    out[:, :-1] += depth.tied[1]
    out[:-1] += 2 * depth.tied[0].astype(np.uint8)
    return out


def errors(maps: Maps, truth: Truth, stored: np.ndarray) -> Iterator[Packed]:
    """Give the errors of normals [deg] and reflectances [root mean square over bands]; 0 where no truth is."""
    angle = angular_error_deg(maps.normal[stored], truth.normal[stored])
    yield "angle_deg", np.where(truth.mask[stored], angle, 0), {}
    if truth.reflectance[truth.mask].any():
        difference = maps.reflectance[stored].astype(np.float64) - truth.reflectance[stored]
        rmse = np.sqrt(np.mean(difference**2, axis=-1))
        yield "rmse", np.where(truth.mask[stored], rmse, 0), {}


def laid_out(signals: Signals, values: np.ndarray, stored: np.ndarray) -> np.ndarray:
    """Give values of the signals' pixels for the stored ones; those of the first pixel where there is none."""
    place = np.zeros(stored.size, np.int64)
    place[signals.pixel] = np.arange(len(signals.pixel))
    return values[place[stored.ravel()]] if len(values) else values


def ring(signals: Signals | None) -> dict | None:
    """Give what the page says of each LED."""
    if signals is None:
        return None
    return {
        "band": numbers(signals.band),
        "direction": numbers(signals.direction),
        "constant_light": float(signals.constant_light),
    }


def camera(depth: Depth | None) -> dict | None:
    """Give where the pixels look."""
    if depth is None:
        return None
    view = depth.camera
    return {
        "perspective": bool(view.perspective),
        "pixel_size": numbers(view.pixel_size),
        "center": numbers(view.center),
    }


def band_colours(wavelength_nm: np.ndarray) -> np.ndarray:
    """Give a colour (n_band, 3) that stands for each band, 0..1: that of its wavelength, grey where it is invisible."""
    nm, rgb = read_table()
    linear = np.stack([np.interp(wavelength_nm, nm, c, 0, 0) for c in rgb.T], axis=-1).clip(min=0)
    strongest = linear.max(axis=-1, keepdims=True)
    visible = strongest > DIMMEST * rgb.max()
    pure = np.where(visible, linear / np.where(visible, strongest, 1), 0.5) ** (1 / 2.2)
    return 0.12 + 0.76 * pure  # softer than a screen can


def numbers(values) -> list:
    """Give plain Python numbers."""
    return np.asarray(values).tolist()
