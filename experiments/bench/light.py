"""Compare the light that a VCD tells with the light that was asked for."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from evsdr import Schedule
from evsdr.events import phase
from evsdr.rig.driver import RingSettings
from experiments.bench.vcd import (
    CYCLES_PER_US,
    N_LED,
    PERIOD,
    Pulses,
    mean_light,
    read_changes,
    read_pulses,
    rises,
)

FULL = 255 / PERIOD  # share of time in which an LED at full brightness is lit


@dataclass(frozen=True)
class Trace:
    """What a VCD tells of a run.

    Attributes
    ----------
    pulses : list of Pulses
        Of the even and of the odd chain.
    rounds, slots : (n,) int64
        Rising edges of the two trigger outputs [cycles].
    end : int
        [cycles]
    """

    pulses: list[Pulses]
    rounds: np.ndarray
    slots: np.ndarray
    end: int


def read_trace(path: Path, n_led: int = N_LED) -> Trace:
    """Read a VCD; raises AssertionError where the shift registers were treated wrongly."""
    change, end = read_changes(path)
    return Trace(read_pulses(change, end, n_led), rises(change["round"]), rises(change["slot"]), end)


def make_schedule(settings: RingSettings) -> Schedule:
    """Give the schedule of settings, its crossfade in whole carrier periods as the firmware rounds it."""
    cycles = int(settings.slot_us) * CYCLES_PER_US
    periods, extra = divmod(cycles, PERIOD)
    fade = int(periods * settings.crossfade + 0.5)
    crossfade = (fade * PERIOD + (extra if fade == periods else 0)) / cycles
    return Schedule(np.array(settings.order, np.int32), settings.slot_us, crossfade)


def period_edges(settings: RingSettings, n_slot: int) -> np.ndarray:
    """Give the edges of all carrier periods of some slots, from the start of the first [cycles]."""
    cycles = int(settings.slot_us) * CYCLES_PER_US
    periods, extra = divmod(cycles, PERIOD)
    within = np.append(0, extra + PERIOD * np.arange(1, periods))
    return np.append((np.arange(n_slot)[:, None] * cycles + within).ravel(), n_slot * cycles)


def light_error(trace: Trace, settings: RingSettings) -> tuple[float, float]:
    """Give the largest difference of an LED's light from the schedule, in two kinds of carrier periods.

    Returns
    -------
    steady, first : float
        Share of full scale, over all LEDs and all periods but the first of each slot; and in those, where
        a chain that hard-switches to another LED of its own stays dark.
    """
    schedule = make_schedule(settings)
    n_slot = (len(trace.rounds) - 1) * len(settings.order)
    edge = period_edges(settings, n_slot)
    middle_us = 0.5 * (edge[1:] + edge[:-1]) / CYCLES_PER_US
    asked = phase.weights(middle_us, schedule, settings.n_led, np.array([0]))
    levels = np.round(255 * np.array(settings.trim)) / 255
    is_first = np.isin(edge[:-1] % (int(settings.slot_us) * CYCLES_PER_US), 0)
    worst = np.zeros(2)
    for led in range(settings.n_led):
        share = mean_light(trace.pulses[led % 2], led, edge + trace.rounds[0]) / FULL
        error = np.abs(share - levels[led] * asked[:, led])
        worst = np.maximum(worst, [error[~is_first].max(), error[is_first].max()])
    return float(worst[0]), float(worst[1])


def stray_pulses(trace: Trace, settings: RingSettings) -> int:
    """Count the pulses of LEDs that are not asked for at that instant."""
    slot_cycles = int(settings.slot_us) * CYCLES_PER_US
    order = np.array(settings.order)
    n_slot = (len(trace.rounds) - 1) * len(order)
    fade = int(round(make_schedule(settings).crossfade * slot_cycles))
    stray = 0
    for pulses in trace.pulses:
        lit = pulses.led >= 0
        start, stop, led = (
            pulses.start[lit] - trace.rounds[0],
            pulses.stop[lit] - trace.rounds[0],
            pulses.led[lit],
        )
        slot = start // slot_cycles
        inside = (slot >= 0) & (slot < n_slot) & (stop <= (slot + 1) * slot_cycles)
        own = led == order[slot % len(order)]
        follows = (led == order[(slot + 1) % len(order)]) & (start - slot * slot_cycles >= slot_cycles - fade)
        stray += int(np.count_nonzero(~(inside & (own | follows))))
    return stray


def edge_error_us(trace: Trace, settings: RingSettings) -> tuple[float, float, int]:
    """Give how far slots start from the schedule [us]: by the slot trigger, by the light; and their number.

    The light must switch hard, from each LED to another one.
    """
    slot_cycles = int(settings.slot_us) * CYCLES_PER_US
    due = trace.rounds[0] + np.arange(len(trace.slots)) * slot_cycles
    by_trigger = np.abs(trace.slots - due).max() / CYCLES_PER_US
    start = np.concatenate([pulses.start[pulses.led >= 0] for pulses in trace.pulses])
    stop = np.concatenate([pulses.stop[pulses.led >= 0] for pulses in trace.pulses])
    slot = (start - trace.rounds[0]) // slot_cycles
    n_slot = len(trace.slots) - 1
    first, last = np.full(n_slot, trace.end), np.zeros(n_slot, np.int64)
    np.minimum.at(first, slot, start)
    np.maximum.at(last, slot, stop)
    by_light = max(np.abs(first - due[:-1]).max(), np.abs(last - due[1:]).max()) / CYCLES_PER_US
    return float(by_trigger), float(by_light), n_slot


def carrier_khz(trace: Trace) -> tuple[float, float]:
    """Give the lowest and the highest frequency of the carrier [kHz], from pulse end to pulse end."""
    step = np.concatenate([np.diff(pulses.stop[pulses.led >= 0]) for pulses in trace.pulses])
    step = step[step < 2 * PERIOD] / CYCLES_PER_US
    return 1e3 / float(step.max()), 1e3 / float(step.min())
