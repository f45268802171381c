"""Dead or swapped LEDs, told from events that contradict light and maps."""

import warnings
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from evsdr.effects.effect import Decision
from evsdr.effects.world import Fitted, World
from evsdr.errors import InputWarning
from evsdr.model.illumination import Illumination
from evsdr.model.lambert import LambertianRing, signals_of
from evsdr.solve import trial
from evsdr.solve.noise import IGNORED
from evsdr.solve.pair_data import PairData, pack_slots
from evsdr.solve.solution import Solution

N_SAMPLE = 600  # pixels that show how well each LED is explained
SUSPICIOUS = 1.4  # residual of an LED, relative to that of most, from which its light is in doubt
N_SUSPECT = 12  # LEDs in doubt at most
N_TRIED = 100  # pixels on which each explanation is tried
FEWEST = 20  # pixels that can convict
DECISIVE = 0.2  # gain of an explanation, relative to the cost of none, from which it is believed


@dataclass(frozen=True)
class Fault:
    """An LED that never shines, or two that shine in each other's slots.

    Attributes
    ----------
    leds : tuple of int
        One dead LED, or two that are swapped.
    """

    leds: tuple

    def mend(self, order: np.ndarray, dark: int = -1) -> np.ndarray:
        """Give the order in which LEDs really shone; `dark` stands for none."""
        order = np.asarray(order)
        if len(self.leds) == 1:
            return np.where(order == self.leds[0], dark, order)
        first, second = self.leds
        return np.where(order == first, second, np.where(order == second, first, order))

    def __str__(self) -> str:
        if len(self.leds) == 1:
            return f"LED {self.leds[0]} gives no light"
        return f"LEDs {self.leds[0]} and {self.leds[1]} are swapped"


def led_residuals(pairs: PairData, light: Illumination, solution: Solution) -> np.ndarray:
    """Give the median of |u| of the events while each LED fades in or out, relative to that of most LEDs.

    Parameters
    ----------
    pairs : PairData
        Event pairs.
    light : Illumination
        What the LEDs send.
    solution : Solution
        The maps that should explain them.

    Returns
    -------
    (n_led,) float
        0 for an LED that has no events.
    """
    offset = pairs.offset.numpy().astype(np.int64)
    explained = (solution.noise_factor < IGNORED) & (np.diff(offset) > solution.theta.shape[1])
    some = np.flatnonzero(explained)
    some = some[:: max(1, len(some) // N_SAMPLE)]
    pixel = np.repeat(some, np.diff(offset)[some])
    k = np.concatenate([np.arange(offset[i], offset[i + 1]) for i in some]) if len(some) else np.arange(0)
    signal = signals_of(LambertianRing(light), solution.theta)
    start, coded = pairs.phases.numpy().reshape(-1, 2)[k].T
    end, polarity = np.abs(coded) - 1, np.sign(coded)
    leds = pairs.slot_leds.numpy()
    now, following = leds & 0xFFFF, leds >> 16
    veil = float(light.constant_light[0])

    def intensity(phase):
        slot = phase.astype(int)
        fade = phase - slot
        return (1 - fade) * signal[now[slot], pixel] + fade * signal[following[slot], pixel] + veil

    gains = np.ones((len(signal[0]), 2)) if solution.threshold_gain is None else solution.threshold_gain
    threshold = np.where(
        polarity > 0,
        (pairs.threshold_on.numpy() * gains[:, 0])[pixel],
        (pairs.threshold_off.numpy() * gains[:, 1])[pixel],
    )
    u = np.abs(polarity * np.log(intensity(end) / intensity(start)) / threshold - 1)
    slot = end.astype(int)
    out = np.zeros(light.n_led)
    for j in range(light.n_led):
        of_led = (now[slot] == j) | (following[slot] == j)
        out[j] = np.median(u[of_led]) if of_led.any() else 0
    return out / max(np.median(out[out > 0]), 1e-9) if out.any() else out


def find_fault(pairs: PairData, light: Illumination, solution: Solution) -> Fault | None:
    """Tell whether an LED is dead or two are swapped, where the residuals leave a doubt.

    Each explanation is tried on a few pixels: it must explain their events decisively better than none does.
    """
    residual = led_residuals(pairs, light, solution)
    if residual.max() < SUSPICIOUS:
        return None
    suspects = sorted(np.argsort(-residual)[:N_SUSPECT].tolist())
    faults = [Fault((j,)) for j in suspects] + [Fault(two) for two in combinations(suspects, 2)]
    explained = np.flatnonzero(np.diff(pairs.offset.numpy().astype(np.int64)) > solution.theta.shape[1])
    pixel = np.random.default_rng(0).permutation(explained)[:N_TRIED]
    if len(pixel) < FEWEST:
        return None
    few = pairs.of_pixels(pixel)
    now = pairs.slot_leds.numpy()[:-1] & 0xFFFF
    orders = [now] + [fault.mend(now, light.n_led) for fault in faults]
    cases = [replace(few, slot_leds=type(pairs.slot_leds)(pack_slots(o, light.n_led))) for o in orders]
    cost = trial.costs(cases, light, pixel, solution.threshold_gain is not None).sum(axis=1)
    best = int(np.argmin(cost[1:]))
    return faults[best] if cost[0] - cost[1 + best] > DECISIVE * abs(cost[0]) else None


class Wiring:
    """A ring that does not shine as told."""

    name, option, when = "wiring", "", "anew"

    def decide(self, asked: str, world: World, fitted: Fitted) -> Decision:
        """Ask the residuals of each LED, and warn the user of a fault."""
        if world.terms.solver != "lm":
            return Decision(self.name, False, "not looked for by the solver adam")
        fault = find_fault(fitted.problem.pairs, fitted.problem.illumination, fitted.solution)
        if fault is None:
            return Decision(self.name, False, "as told: the events contradict no LED")
        warnings.warn(
            InputWarning(
                f"{world.recording.source}: {fault}, say the events, and the fit took that for true; "
                "check the ring and schedule/order."
            )
        )
        return Decision(self.name, True, f"{fault}, say the events", None, {"leds": list(fault.leds)}, fault)

    def model(self, world: World, decision: Decision) -> World:
        """Take the LEDs to have shone in the order that the events tell."""
        schedule = world.recording.schedule
        schedule = replace(schedule, order=decision.answer.mend(schedule.order))
        return replace(world, recording=replace(world.recording, schedule=schedule))
