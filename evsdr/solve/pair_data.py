"""Event pairs as Dr.Jit arrays: how they are packed, chosen and looked up."""

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace

import drjit as dr
import numpy as np


@dataclass(frozen=True)
class PairData:
    """Event pairs of the pixels to solve, as Dr.Jit arrays.

    Attributes
    ----------
    offset : UInt32, (n_pixel + 1)
        Pairs of pixel i are offset[i] .. offset[i+1].
    phases : Float, (n_pair * 2)
        For each pair the phase of the ring (slot + crossfade fraction) at its start, and 1 + that at its
        end, with the sign of its polarity.
    threshold_on, threshold_off : Float, (n_pixel)
        Contrast thresholds.
    slot_leds : UInt32, (n_slot + 1)
        LED of each slot, plus 65536 times that of the next; LED n_led is darkness. The first slot stands
        again at the end, for phases that round up.
    silent_offset : UInt32, (n_pixel + 1), optional
        Silent probes of pixel i are silent_offset[i] .. silent_offset[i+1].
    silent_phases : Float, (n_probe * 2), optional
        For each probe the phase at which the reference was memorised and 1 + that of the probe.
    weight : Float, (n_pair), optional
        How much a pair counts; 1 by default.
    """

    offset: object
    phases: object
    threshold_on: object
    threshold_off: object
    slot_leds: object
    silent_offset: object = None
    silent_phases: object = None
    weight: object = None


def without(pairs: PairData, ignored: np.ndarray) -> PairData:
    """Leave out all events and silences of some pixels, ignored (n_pixel) bool."""
    return _choose(pairs, lambda count: np.where(ignored, 0, count))


def thin(pairs: PairData, most: int) -> PairData:
    """Keep at most so many events and silences of each pixel, spread evenly over the recording."""
    return _choose(pairs, lambda count: np.minimum(count, most))


def _choose(pairs: PairData, kept: Callable) -> PairData:
    """Keep as many entries of each pixel's lists as `kept` makes of their numbers (n_pixel), spread evenly."""

    def part(offset, *lists):
        first = offset.numpy().astype(np.int64)
        count = np.diff(first)
        some = kept(count)
        new = np.concatenate([[0], np.cumsum(some)])
        within = np.arange(new[-1]) - np.repeat(new[:-1], some)
        k = np.repeat(first[:-1], some) + within * np.repeat(count, some) // np.maximum(
            np.repeat(some, some), 1
        )
        chosen = (type(v)(v.numpy().reshape(first[-1], -1)[k].ravel()) for v in lists)
        return type(offset)(new.astype(np.uint32)), *chosen

    offset, phases = part(pairs.offset, pairs.phases)
    weight = pairs.weight if pairs.weight is None else part(pairs.offset, pairs.weight)[1]
    pairs = replace(pairs, offset=offset, phases=phases, weight=weight)
    if pairs.silent_offset is None:
        return pairs
    silent_offset, silent_phases = part(pairs.silent_offset, pairs.silent_phases)
    return replace(pairs, silent_offset=silent_offset, silent_phases=silent_phases)


def pack_phases(start: np.ndarray, end: np.ndarray, polarity: np.ndarray) -> np.ndarray:
    """Interleave phases (n_pair) for `PairData`: one look-up fetches all there is to know of a pair."""
    return np.stack([start, polarity * (1 + end)], axis=-1).astype(np.float32).ravel()


def pack_slots(order: np.ndarray, n_led: int) -> np.ndarray:
    """Combine the LED of each slot with that of the next for `PairData`; -1 is darkness."""
    led = np.where(order < 0, n_led, order).astype(np.uint32)
    leds = led + np.uint32(65536) * np.roll(led, -1)
    return np.append(leds, leds[0])


def unpack_pair(phases, k, active):
    """Fetch phase at start, phase at end and polarity of pair k."""
    Float = type(phases)
    start, coded = dr.gather(_array(Float, 2), phases, k, active)
    return start, dr.abs(coded) - 1.0, dr.select(coded > 0, Float(1.0), Float(-1.0))


def _array(Float: type, size: int) -> type:
    """Give the type of small vectors of a Float type."""
    return getattr(sys.modules[Float.__module__], f"Array{size}f")


def _lit(pairs: PairData, phase, active):
    """Tell which two LEDs are lit at a phase, and their shares."""
    slot = type(pairs.offset)(phase)
    fade = phase - type(phase)(slot)
    leds = dr.gather(type(pairs.offset), pairs.slot_leds, slot, active)
    return ((leds & 0xFFFF, 1.0 - fade), (leds >> 16, fade))


# ---------------------------------------------------------------------- residuals


def signal_table(signal: list, n_pixel: int):
    """Lay per-LED values out LED after LED, with a row of zeros for darkness: ((n_led + 1) * n_pixel)."""
    Float = type(signal[0])
    rows = [dr.zeros(Float, n_pixel) + row for row in signal] + [dr.zeros(Float, n_pixel)]
    return dr.concat(rows)


def ends(table, pairs: PairData, k, pixel, n_pixel, active):
    """Look up the values of a `signal_table` at start and end of pair k, and the pair's polarity."""
    Float = type(pairs.phases)
    *phases, polarity = unpack_pair(pairs.phases, k, active)
    values = [
        sum(
            share * dr.gather(Float, table, led * n_pixel + pixel, active)
            for led, share in _lit(pairs, phase, active)
        )
        for phase in phases
    ]
    return *values, polarity
