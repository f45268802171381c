"""How LEDs fade into each other, if otherwise than told: by how well all that pixels share then explains their events.

Photoreceptors that lag pass for LEDs that fade less, and their lag depends on the light: so each crossfade is judged with the lag, the shift and
the thresholds that it would take, by the evidence that their joint search leaves (MacKay 2003, ch. 28).
"""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import minimize_scalar

from evsdr.effects.hypotheses import Finding, Hypothesis, mend_schedule
from evsdr.effects.shared import Asked, asked_of, start_from
from evsdr.events.phase import position
from evsdr.jit import one_thread
from evsdr.records import Recording
from evsdr.solve.shared.infer import Inferred
from evsdr.solve.shared.pixels import FEWEST_PIXELS, choose
from evsdr.solve.shared.posterior import Start

if TYPE_CHECKING:
    from evsdr.effects.world import Fitted, World

N_PIXEL = 40  # that are asked; guessed: 60 find the same crossfades in `experiments.draws` (16, 1134, 1143, 1156, 1185, 1188)
# Of `rig.GROUPS`: may pass for another crossfade
TAKEN = "powers", "lag", "shift", "refractory", "thresholds"
FADES = 0.0, 0.05, 0.11, 0.2, 0.3, 0.4, 0.57, 0.8, 1.0  # that are tried; guessed
BESIDE = 0.75, 1.33  # times what is told: tried first, with `QUICK` beside 0; guessed
QUICK = 0.05, 0.17
# Log evidence of an event, by which another crossfade must be better to convict what is told, and beside what is told, to look for one; the first so many
# times where powers are told by hardly anything but the files, as on planes. Guessed, between what was measured (68 of `experiments.draws`: 0 to 34 and
# 1134 to 1167): over the right one .06 at most where LEDs fade, but .72 on a plane (8), .4 where they switch, .79 where a simulator blends frames (1136);
# of the right one over .8, .6, .4 and 1 told wrong .6 to 3.8 (16, 1134, 1142, 1143, 1156, 1163, 1185, 1188)
WORTH, HINT, VALLEY = 0.5, 0.1, 2.0
FINE, DIGITS = 0.03, 3  # to which part of itself a crossfade is sought, and its decimals; guessed
WITHIN = 0.5  # part of a slot in which LEDs fade as told, at least, to tell by times that they switch: light changes in its second half then; guessed
# Share of the events in the first half of the slots from which LEDs may switch, and of how many events, at least and about at most. Measured (a sphere, an EVK4,
# and 26 of `experiments.draws`, 0 to 59, all pixels): .93 to 1.0 under LEDs that switch, in slots of 3 ms and more, .33 to .51 under such that fade within all of
# the slot, .14 to .55 within .3 of it. Guessed between these
AT_STARTS, FEWEST_TIMED, N_TIMED = 0.9, 100, 1_000_000


def find_crossfade(world: "World", fitted: "Fitted") -> Finding | None:
    """Look for a crossfade that explains the events better than the told one."""
    row = choose(fitted.problem, fitted.solution, N_PIXEL)
    if len(row) < FEWEST_PIXELS:
        return None
    evidence, told = Evidence(world, fitted, row), world.recording.schedule.crossfade
    hinted = may_switch(world.recording) or max(map(evidence, beside(told))) > evidence(told) + HINT
    best = most_likely(evidence, told) if hinted else told
    gain = evidence(best) - evidence(told)
    if gain < WORTH * (VALLEY if evidence.doubts_powers(best) else 1):
        return None
    times = np.exp(gain)
    return Finding(
        fading(best), f"with that, each event is {times:.{1 if times < 10 else 0}f} times as likely"
    )


class Evidence:
    """Log evidence of an event under a crossfade, remembered."""

    def __init__(self, world: "World", fitted: "Fitted", row: np.ndarray):
        terms = replace(world.terms, shared=TAKEN)
        self.world, self.fitted, self.row, self.found = replace(world, terms=terms), fitted, row, {}

    def __call__(self, crossfade: float) -> float:
        found, n_event = self._found(crossfade)
        return -found.surprise / n_event

    def doubts_powers(self, crossfade: float) -> bool:
        """Tell whether events know powers hardly better than they are told."""
        return "powers" in self._found(crossfade)[0].doubted

    def in_vain(self, crossfade: float) -> bool:
        """Tell whether events contradict the model even so."""
        return self._found(crossfade)[0].in_vain

    def ask_from(self, other: float, crossfade: float) -> None:
        """Search once more, from where the search under another ended: from maps that are bent it may stay away; what is less of a surprise stands.

        Measured (a sphere of 24 x 24, slots of 3 ms, LEDs that switch and are told to fade): 1.4 for 0, 2.3 for .03, where rounding has it; 2.2 so.
        """
        found, n_event = self._found(crossfade)
        again = self._search(self._asked(crossfade), start_from(self._found(other)[0]))
        self.found[crossfade] = min(found, again, key=lambda one: one.surprise), n_event

    def _found(self, crossfade: float) -> tuple:
        if crossfade not in self.found:
            asked = self._asked(crossfade)
            self.found[crossfade] = self._search(asked), asked.pixels.n_event
        return self.found[crossfade]

    def _asked(self, crossfade: float) -> Asked:
        return asked_of(fading(crossfade).mend(self.world), self.fitted, self.row)

    def _search(self, asked: Asked, start: Start | None = None) -> Inferred:
        with one_thread():
            return asked.search(asked.names, start)


def most_likely(evidence: Evidence, told: float) -> float:
    """Give the best crossfade: that of LEDs that switch, or fade all along, if it is hardly worse, as rings do either; what is told, if all are in vain."""
    values = sorted({*FADES, told, *beside(told)})
    best = max(range(len(values)), key=lambda k: evidence(values[k]))
    if evidence.in_vain(values[best]):
        return told
    bounds = values[max(best - 1, 0)], values[min(best + 1, len(values) - 1)]
    minimize_scalar(
        lambda value: -evidence(round(float(value), DIGITS)),
        bounds=bounds,
        method="bounded",
        options={"xatol": FINE * bounds[1]},
    )
    best = max(evidence.found, key=evidence)
    end = float(round(best))
    if end not in (best, told):
        evidence.ask_from(best, end)
    usual = [end for end in (0.0, 1.0) if end != told and evidence(end) > evidence(best) - WORTH]
    return max(usual, key=evidence, default=best)


def beside(told: float) -> tuple[float, ...]:
    """Give crossfades of which one is better, if another is."""
    return QUICK if told == 0 else tuple(round(min(told * factor, 1.0), DIGITS) for factor in BESIDE)


def fading(crossfade: float) -> Hypothesis:
    """Describe one."""
    words = {0.0: "the LEDs switch without fading", 1.0: "the LEDs fade into each other"}
    what = words.get(crossfade, f"the LEDs fade within {crossfade:.2g} of a slot")
    return Hypothesis(
        what, f"write crossfade = {crossfade:.3g} in schedule", mend_schedule(crossfade=crossfade)
    )


def may_switch(recording: Recording) -> bool:
    """Tell whether hardly any events come in the second half of slots, in which light changes as told; they follow switches with their lag."""
    return recording.schedule.crossfade >= WITHIN and share_at_starts(recording) > AT_STARTS


def share_at_starts(recording: Recording) -> float:
    """Give the share of the events that come in the first half of a slot; none if they are few."""
    t = recording.events.t[:: max(1, len(recording.events.t) // N_TIMED)]
    at, inside = position(t, recording.schedule, recording.round_start_us)
    return float(np.mean(at[inside] % 1 < 0.5)) if np.count_nonzero(inside) >= FEWEST_TIMED else 0.0
