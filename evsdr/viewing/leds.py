"""Whether each LED gives light: the level of log light of each pixel while it is lit, summed up from the events."""

from dataclasses import dataclass

import numpy as np

from evsdr.events.phase import position
from evsdr.records import Events, Schedule
from evsdr.viewing.sample import Sample

BRIGHTEST = 98.0  # percentile of the pixels by which an LED is judged: it may shine past most of them
# Of a pixel's range of log light, above its darkest; measured: dead LEDs 0.07 to 0.23, the dimmest of a chart 0.45
DEAD = 0.33
FEWEST, LEAST = 20, 1.5  # pixels; range of log light of a pixel, in thresholds
MOST_DEAD = 0.5  # of the LEDs: then something else is wrong


@dataclass(frozen=True)
class Leds:
    """What the events say of each LED.

    Attributes
    ----------
    rise : (n_led,) float
        How far an LED's light is above the darkest, as a share of the range, in the pixels that it lights best; not a
        number for LEDs that are not in the order.
    """

    rise: np.ndarray

    @property
    def dead(self) -> list[int]:
        """List the LEDs that give no light."""
        dark = np.flatnonzero(self.rise < DEAD)
        return dark.tolist() if len(dark) <= MOST_DEAD * np.count_nonzero(self.rise == self.rise) else []


def slot_counts(events: Events, schedule: Schedule, starts: np.ndarray) -> np.ndarray:
    """Count the OFF and ON events (2, n_slot) of each slot."""
    at, inside = position(events.t, schedule, starts)
    n_slot = len(schedule.order)
    slot = np.minimum(at.astype(np.int64), n_slot - 1)
    return np.bincount((events.p.astype(np.int64) * n_slot + slot)[inside], minlength=2 * n_slot).reshape(
        2, n_slot
    )


def find_leds(sample: Sample, schedule: Schedule, starts: np.ndarray) -> Leds | None:
    """Look at the light of each LED; None where there is not a whole round, or hardly any pixel."""
    level = levels(sample, schedule, starts)
    if level is None:
        return None
    span = np.ptp(level, axis=1)
    level, span = level[span > LEAST], span[span > LEAST]
    if len(level) < FEWEST:
        return None
    rise = np.percentile((level - level.min(axis=1, keepdims=True)) / span[:, None], BRIGHTEST, axis=0)
    order = np.asarray(schedule.order)
    out = np.full(order.max() + 1, np.nan)
    for led in np.unique(order[order >= 0]):
        out[led] = rise[order == led].max()
    return Leds(out)


def levels(sample: Sample, schedule: Schedule, starts: np.ndarray) -> np.ndarray | None:
    """Give log light (n_pixel, n_slot) of each pixel when the LED of each slot is lit alone, in thresholds of ON events.

    The sum of events, of which OFF count so much that both cancel over the recording, averaged over whole rounds.
    """
    n_slot, slot_us = len(schedule.order), schedule.slot_us
    begin = starts[0] if len(starts) else schedule.start_us
    end = starts[-1] if len(starts) else sample.t.max()
    turns, _ = position(sample.t, schedule, starts)
    n_round = int(round((min(end, sample.t.max() + slot_us) - begin) / (n_slot * slot_us)))
    if n_round < 1:
        return None
    number = np.floor((sample.t - begin) / (n_slot * slot_us) - turns / n_slot + 0.5).astype(np.int64)
    knot = np.ceil(number * n_slot + turns - (1 - schedule.crossfade)).astype(np.int64)
    inside = (knot >= 0) & (knot < n_round * n_slot)
    n = len(sample.place)
    on, off = (np.bincount(sample.pixel, sample.p == sign, n) for sign in (1, -1))
    step = np.where(sample.p > 0, 1.0, -(on / np.maximum(off, 1))[sample.pixel])
    cell = (sample.pixel * n_round * n_slot + np.where(inside, knot, 0))[inside]
    change = np.bincount(cell, step[inside], n * n_round * n_slot).reshape(n, n_round * n_slot)
    level = np.cumsum(change, axis=1).reshape(n, n_round, n_slot)
    return (level - level.mean(axis=2, keepdims=True)).mean(axis=1)
