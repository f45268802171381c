"""How well the schedule fits the events: do they come again with every round, and does light only rise or fall in a slot."""

from dataclasses import dataclass, replace

import numpy as np

from evsdr.records import Schedule
from evsdr.rig.repetition import Repetition
from evsdr.viewing.rounds import ON_GRID, Triggers
from evsdr.viewing.sample import Sample, coherence
from evsdr.viewing.source import with_slots

FACTORS = 0.1, 0.5, 2.0, 10.0  # by which slots are told wrong
MULTIPLES = 6  # of the shortest time after which events come again, that a round may be: bands repeat on flat surfaces
# Of coherence and repetition, by which another length of slots must fit better; measured: doubled slots 0.11, others more
BETTER = 0.08
ALIKE = 0.03  # of that: of lengths that fit alike the longest is taken, as short slots always fit
SHIFTS = np.arange(-10, 11) / 20  # of a slot
# Of coherence, by which another start must fit better, and how far it must be, in slots; measured: pixels lag up to 0.1
SHIFTED, LEAST_SHIFT = 0.02, 0.15
NEAR_BEST = 0.005  # of coherence: of starts that fit as well the nearest is taken


@dataclass(frozen=True)
class ScheduleFit:
    """What the events say of the schedule.

    Attributes
    ----------
    schedule : Schedule
        As it is believed.
    starts : (n,) int64
        Of rounds, and the end of the last; empty where `schedule.start_us` counts.
    told, believed : float
        How well the schedule fits, as told and as believed, 0..1.
    period_us : float
        Shortest time after which events come again; 0 if there is none.
    repeat : float
        How far they do, after a round.
    coherence : float
        See `sample.coherence`.
    shift : (n_shift,) float
        The same with all starts shifted by `SHIFTS`.
    """

    schedule: Schedule
    starts: np.ndarray
    told: float
    believed: float
    period_us: float
    repeat: float
    coherence: float
    shift: np.ndarray

    @property
    def wrong(self) -> bool:
        """Whether slots last otherwise than told."""
        return self.believed > self.told

    @property
    def late_us(self) -> float:
        """Give how much later than told the rounds start [us]; 0 if the events don't contradict it."""
        best = self.shift.max()
        shift = min(SHIFTS[self.shift > best - NEAR_BEST], key=abs)
        if abs(shift) < LEAST_SHIFT or best - self.shift[np.argmin(np.abs(SHIFTS))] < SHIFTED:
            return 0.0
        return float(shift * self.schedule.slot_us)


def fit_schedule(
    told: Schedule, triggers: Triggers | None, sample: Sample, repetition: Repetition
) -> ScheduleFit:
    """Look at how well a schedule fits, and whether slots of another length fit better."""
    n_slot, told_us = len(told.order), told.slot_us * len(told.order)
    period, most = repetition.shortest()
    every = triggers.round_us if triggers else 0.0
    if triggers:
        told = replace(told, start_us=float(triggers.edge_us[0]))

    def score(round_us):
        again = repetition.after(round_us)
        again = 1.0 if np.isnan(again) or most <= 0 else np.clip(again / most, 0, 1)
        return coherence(sample, with_slots(told, round_us), np.empty(0)) * again

    others = {f * told_us for f in FACTORS} | {m * period for m in range(1, 1 + MULTIPLES)} | {every}
    others = [t for t in others if t / n_slot > 50 and t < repetition.duration_us]
    as_told = score(told_us)
    whole = not triggers or abs(every / told_us - max(round(every / told_us), 1)) < ON_GRID
    scores = {t: score(t) for t in others}
    top = max(scores.values(), default=0.0)
    round_us, believed = told_us, as_told
    if top > as_told + BETTER or not whole:
        alike = [t for t in others if scores[t] > top - ALIKE]
        round_us = every if every in alike or not alike else max(alike)
        believed = max(scores.get(round_us, 0.0), as_told + 1e-3)
    schedule = with_slots(told, round_us)
    starts = triggers.start_us if triggers and abs(every / round_us - 1) < ON_GRID else np.empty(0, np.int64)
    step = schedule.slot_us * SHIFTS
    shifted = [coherence(replace(sample, t=sample.t - s), schedule, starts) for s in step]
    again = repetition.after(round_us)
    return ScheduleFit(
        schedule,
        starts,
        as_told,
        believed,
        period,
        0.0 if np.isnan(again) else again,
        coherence(sample, schedule, starts),
        np.array(shifted),
    )
