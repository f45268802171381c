"""Times: the clock's steps, how long slots last, and light and events that do not share one start."""

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from evsdr.effects.effect import Decision
from evsdr.effects.shared import WARNED, SharedEffect, SharedFound, plus_minus
from evsdr.events.period import Period, find_period, root_mean_square, unevenness
from evsdr.records import Events, Recording

if TYPE_CHECKING:
    from evsdr.effects.world import Fitted, World

CLEAR = 4.0  # standard deviations from which slots last otherwise than told
JITTER = 0.01  # slots: standard deviation of triggers from which these are evened out; guessed
WARNED_PPM = 10_000  # resonators are within half of that
PPM = 1e6
FEWEST_EVENTS = 100  # that tell a clock's step: chance gives them a common divisor once in 2^100
COARSEST = 0.25  # slots: events that come only where light switches have a longer common divisor


class ClockStep:
    """Times in steps of more than a microsecond: an event came within its step, in the middle of it on average.

    The last step before an event is what a clock writes. Triggers come so, too, unless they are whole rounds apart to
    the microsecond: then the ring runs by that clock, and starts on a step.
    """

    name, option, when = "clock's step", "", "scene"

    def decide(self, asked: str, world: "World", fitted: "Fitted | None") -> Decision | None:
        """Look for the common divisor of all times."""
        recording = world.recording
        step = step_of(recording.events.t)
        if not 1 < step <= COARSEST * recording.schedule.slot_us:
            return None
        why = f"times are whole steps of {step} us; events are taken to be spread evenly over their step"
        return Decision(self.name, True, why, None, {"step_us": step}, in_the_middle(recording, step))

    def model(self, world: "World", decision: Decision) -> "World":
        """Let events come within their steps."""
        return replace(world, recording=decision.answer, clock_us=float(decision.found["step_us"]))


def step_of(t: np.ndarray) -> int:
    """Give the greatest common divisor of times (n,) int64 [us] after the first, 0 where they are too few to tell."""
    return int(np.gcd.reduce(t - t[0])) if len(t) >= FEWEST_EVENTS else 0


def in_the_middle(recording: Recording, step: int) -> Recording:
    """Spread the events that a pixel has in one step evenly over it."""
    events, starts = recording.events, np.asarray(recording.round_start_us)
    pixel = events.y.astype(np.int64) * recording.sensor.width + events.x
    order = np.lexsort((events.t, pixel))
    new = np.append(True, (np.diff(pixel[order]) != 0) | (np.diff(events.t[order]) != 0))
    first, group = np.flatnonzero(new), np.cumsum(new) - 1
    number = np.arange(len(order)) - first[group]
    t = np.empty(len(order), np.int64)
    t[order] = events.t[order] + ((number + 0.5) / np.bincount(group)[group] * step).astype(np.int64)
    by_time = np.argsort(t, kind="stable")
    events = Events(*(values[by_time] for values in (events.x, events.y, events.p, t)))
    apart = np.diff(starts)
    if len(apart) and not np.any(apart % step) and np.any(apart % _round_us(recording)):
        starts = starts + 0.5 * step
    return replace(recording, events=events, round_start_us=starts)


class SlotLength:
    """Slots that are longer or shorter than told: triggers follow them; without, or if these jitter, the events tell."""

    name, option, when = "slot length", "", "scene"

    def decide(self, asked: str, world: "World", fitted: "Fitted | None") -> Decision:
        """Compare with triggers, or else fold the events."""
        recording = world.recording
        number = _rounds_until(recording) if len(recording.round_start_us) > 1 else np.zeros(0)
        jitter = root_mean_square(unevenness(number, recording.round_start_us)) if len(number) else 0.0
        if len(number) and jitter <= JITTER * recording.schedule.slot_us:
            return self._by_triggers(recording, number)
        period = find_period(recording)
        if len(number):
            return self._evened(recording, number, jitter, period)
        if period is None:
            return Decision(self.name, False, "as told: the events do not tell it, and no triggers do")
        off, sigma, told = PPM * (period.ratio - 1), PPM * period.sigma, recording.schedule.slot_us
        clear = abs(off) > CLEAR * sigma
        numbers = {"told_us": told, "found_us": told * period.ratio, "sigma_us": told * period.sigma}
        why = f"{'as events repeat' if clear else 'as told'}: these do {off:+.0f} +- {sigma:.2g} ppm after rounds as told"
        warning = (
            f"rounds last {1 + off / PPM:.4f} times what slot_us says; check it."
            if abs(off) > WARNED_PPM
            else ""
        )
        found = {"slot_us": numbers, "clock_ppm": off}
        schedule = replace(recording.schedule, slot_us=numbers["found_us"])
        return Decision(self.name, clear, why, None, found, replace(recording, schedule=schedule), warning)

    def _by_triggers(self, recording: Recording, number: np.ndarray) -> Decision:
        """Say how far rounds, between triggers and relative to what is told, are off, and how that changes."""
        each = np.diff(recording.round_start_us) / (_round_us(recording) * np.diff(number))
        middle = np.arange(len(each)) - 0.5 * (len(each) - 1)
        drift = PPM * (middle @ each) / max(middle @ middle, 1) * (len(each) - 1)
        off = PPM * (np.median(each) - 1)
        why = f"by triggers: {off:+.0f} ppm against what is told, and {drift:+.0f} ppm from the first round to the last"
        return Decision(self.name, False, why, found={"clock_ppm": float(off), "drift_ppm": float(drift)})

    def _evened(
        self, recording: Recording, number: np.ndarray, jitter: float, period: Period | None
    ) -> Decision:
        """Put triggers that jitter on an even clock, whose rate the events tell, or else these triggers."""
        starts, told = np.asarray(recording.round_start_us, float), _round_us(recording)
        round_us = told * period.ratio if period else np.polyfit(number, starts, 1)[0]
        even = np.median(starts - round_us * number) + round_us * number
        off = PPM * (round_us / told - 1)
        who = "the events' repeating" if period else "a line through them"
        why = f"by {who}, {off:+.0f} ppm against what is told: triggers jitter by {jitter:.0f} us"
        found = {"clock_ppm": float(off), "trigger_jitter_us": jitter}
        warning = f"triggers jitter by {jitter:.0f} us, so an even clock was put through them; wire the ring's to the camera."
        return Decision(self.name, True, why, None, found, replace(recording, round_start_us=even), warning)

    def model(self, world: "World", decision: Decision) -> "World":
        """Let slots last as long as they do."""
        return replace(world, recording=decision.answer)


def _round_us(recording: Recording) -> float:
    return recording.schedule.slot_us * len(recording.schedule.order)


def _rounds_until(recording: Recording) -> np.ndarray:
    """Count the rounds until each trigger (n,), from the first."""
    whole = np.maximum(np.rint(np.diff(recording.round_start_us) / _round_us(recording)), 1)
    return np.append(0, np.cumsum(whole))


class TimeShift(SharedEffect):
    """All events come late, or triggers early, by the same time."""

    name, group = "shift of all times", "shift"
    untold = "light without a lag does not tell it"

    def say(self, found: SharedFound) -> str:
        """Give the shift."""
        return f"events are {plus_minus(found.us('shift'))} late"

    def warning(self, found: SharedFound) -> str:
        """Give the shift, if it is more than triggers can be off, or noise fires events early."""
        shift, sigma = found.us("shift")
        if abs(shift) <= WARNED * math.hypot(found.told.shift_us, sigma):
            return ""
        return f"events are {shift:.3g} us late against the triggers or start_us; check these."

    def numbers(self, found: SharedFound) -> dict:
        """Give it in numbers."""
        return dict(zip(("shift_us", "shift_sigma_us"), found.us("shift")))

    def model(self, world: "World", decision: Decision) -> "World":
        """Start rounds that much later."""
        recording, (shift, _) = world.recording, decision.answer.us("shift")
        schedule = replace(recording.schedule, start_us=recording.schedule.start_us + shift)
        starts = np.asarray(recording.round_start_us, float) + shift
        return replace(world, recording=replace(recording, schedule=schedule, round_start_us=starts))
