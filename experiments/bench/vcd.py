"""Read what the pins did (a VCD), and what light the shift registers made of it."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numba import njit

CYCLE = 625  # of the VCD's time unit
CYCLES_PER_US = 16
PERIOD = 256  # cycles of the carrier
N_LED = 24


@dataclass(frozen=True)
class Pulses:
    """Stretches of time in which one LED shines without a break.

    Attributes
    ----------
    start, stop : (n_pulse,) int64
        [cycles of the processor]
    led : (n_pulse,) int64
        -1 where an output enable was low but no LED latched.
    """

    start: np.ndarray
    stop: np.ndarray
    led: np.ndarray


def read_changes(path: Path) -> tuple[dict[str, tuple[np.ndarray, np.ndarray]], int]:
    """Give times [cycles] and new values of each signal of one bit, and the time of the end."""
    data = Path(path).read_bytes()
    head, _, body = data.partition(b"$enddefinitions $end\n")
    names = {}
    for line in head.splitlines():
        if line.startswith(b"$var"):
            _, _, _, symbol, name, _ = line.split()
            names[symbol[0]] = name.decode()
    time, symbol, value, end = _parse(np.frombuffer(body, np.uint8))
    change = {}
    for code, name in names.items():
        own = symbol == code
        change[name] = (time[own] // CYCLE, value[own])
    return change, int(end) // CYCLE


@njit(cache=True)
def _parse(text):
    room = len(text) // 4 + 1
    time, symbol, value = np.empty(room, np.int64), np.empty(room, np.uint8), np.empty(room, np.int8)
    n, now, i = 0, 0, 0
    while i < len(text):
        c = text[i]
        if c == 35:  # '#'
            now, i = 0, i + 1
            while i < len(text) and text[i] != 10:
                now = 10 * now + text[i] - 48
                i += 1
        elif c == 48 or c == 49:
            time[n], symbol[n], value[n] = now, text[i + 1], c - 48
            n += 1
        while i < len(text) and text[i] != 10:
            i += 1
        i += 1
    return time[:n], symbol[:n], value[:n], now


def rises(change: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Give the times of a signal's rising edges."""
    time, value = change
    return time[1:][(value[1:] == 1) & (value[:-1] == 0)]


def latched(change: dict, data: str, bits: int) -> tuple[np.ndarray, np.ndarray]:
    """Give when a chain's latches took what pattern, bit n for its output n; empty latches at first."""
    clock, latch = rises(change["clock"]), rises(change["latch"])
    time, value = change[data]
    bit = value[np.searchsorted(time, clock, side="right") - 1].astype(np.int64)
    bit = np.concatenate([np.zeros(bits, np.int64), bit])
    last = np.searchsorted(clock, latch) + bits  # one past the last bit that was in
    pattern = sum(bit[last - 1 - n] << n for n in range(bits))
    return np.append(0, latch), np.append(0, pattern)


def read_pulses(change: dict, end: int, n_led: int = N_LED) -> list[Pulses]:
    """Give what shone in the even and in the odd chain.

    Raises
    ------
    AssertionError
        Two LEDs of a chain shone at once, one shone that is not there, or the latches took another pattern
        while the chain was lit.
    """
    chains = []
    for chain, name in enumerate(("even", "odd")):
        time, value = change[f"oe_{name}"]
        start, stop = time[value == 0], time[value == 1]
        stop = np.append(stop[stop > (start[0] if len(start) else end)], end)[: len(start)]
        at, pattern = latched(change, f"data_{name}", 8 * -(-n_led // 16))
        held = pattern[np.searchsorted(at, start, side="right") - 1]
        for k in np.flatnonzero(np.diff(pattern)) + 1:
            i = np.searchsorted(start, at[k], side="right") - 1
            assert i < 0 or at[k] >= stop[i], (
                f"{name} chain: latched while lit, at {at[k] / CYCLES_PER_US} us"
            )
        assert (held & (held - 1) == 0).all() and (held < 1 << n_led // 2).all(), f"{name} chain: two LEDs"
        output = np.where(held > 0, np.log2(np.maximum(held, 1)), 0).astype(np.int64)
        chains.append(Pulses(start, stop, np.where(held > 0, 2 * output + chain, -1)))
    return chains


def mean_light(pulses: Pulses, led: int, edge: np.ndarray) -> np.ndarray:
    """Give the share of time in which an LED shines between any two edges [cycles]."""
    own = pulses.led == led
    start, stop = pulses.start[own], pulses.stop[own]
    if not len(start):
        return np.zeros(len(edge) - 1)
    knot = np.ravel(np.column_stack([start, stop]))
    total = np.ravel(np.column_stack([np.append(0, np.cumsum(stop - start)[:-1]), np.cumsum(stop - start)]))
    return np.diff(np.interp(edge, knot, total)) / np.diff(edge)
