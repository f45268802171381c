"""Where a fit explains the events less well than elsewhere, in words.

Residuals that come again in every round are no noise, see `solve.noise`. Where they are larger than elsewhere tells of
what the model lacks: an LED that is not as told, light that gets to a region by another way, the dark (constant light, lag),
slow light (leak, noise of the photoreceptors), highlights (gloss).
"""

from dataclasses import dataclass, replace

import numpy as np

from evsdr.effects.world import Fitted
from evsdr.solve.loop import data_of, resume
from evsdr.solve.noise import Slotted, slotted
from evsdr.solve.stages import softness_at

END = 0.1  # of the events that are the darkest, the slowest, the brightest of their pixel
# Standard errors, and ratio of standard deviations, from which a place is named; guessed
CLEAR, LARGER = 4.0, 1.5
N_PIXEL = 4000  # that are looked at
FEWEST = 100  # events at a place
ROWS, COLUMNS = ("top", "middle", "bottom"), ("left", "centre", "right")


@dataclass(frozen=True)
class Misfit:
    """What noise does not explain of the events.

    Attributes
    ----------
    words : str
        How large residuals are that come again in every round, and where they are larger.
    least : float
        Of a threshold, how large they are at least; 0 where noise may make them.
    """

    words: str
    least: float


def explain_misfit(fitted: Fitted, robust: float) -> Misfit:
    """Look for residuals that come again in every round; `robust` as of the fit."""
    problem, solution = fitted.problem, fitted.solution
    light = problem.illumination
    data = data_of(problem.model, problem.pairs, light.constant_light, problem.grid, robust)
    state = replace(resume(data, solution), noise=solution.noise)
    if solution.curved:
        state = replace(state, softness=softness_at(data, state.theta))
    pairs = slotted(data, state, N_PIXEL)
    leds = problem.pairs.slot_leds.numpy().astype(np.int64)
    where = places(pairs, leds, light.n_led, problem.grid.mask)
    return Misfit(in_words(pairs, where, solution.noise), least_of(pairs))


def least_of(pairs: Slotted) -> float:
    """Give how large residuals that come again in every round are at least, from how pixels differ in them."""
    known = np.isfinite(pairs.shared)
    number = np.bincount(pairs.pixel[known])
    if np.count_nonzero(number) < FEWEST:
        return 0.0
    of_pixel = np.bincount(pairs.pixel[known], pairs.shared[known])[number > 0] / number[number > 0]
    return _root(np.mean(of_pixel) - CLEAR * np.std(of_pixel) / len(of_pixel) ** 0.5)


def places(pairs: Slotted, slot_leds: np.ndarray, n_led: int, mask: np.ndarray) -> dict[str, np.ndarray]:
    """Give which events, (n,) bool, lie at which place, by what is said of it."""
    slot, fade = np.divmod(pairs.end, 1)
    both = slot_leds[slot.astype(np.int64)]
    led = np.where(fade < 0.5, both & 0xFFFF, both >> 16)
    row, column = (np.asarray(at)[pairs.pixel] for at in np.nonzero(mask))
    third = (
        [3 * (at - at.min()) // (at.max() - at.min() + 1) for at in (row, column)] if len(row) else (row, row)
    )
    span = np.mod(pairs.end - pairs.start, len(slot_leds) - 1)
    brightest = np.zeros(len(mask.ravel()))
    np.maximum.at(brightest, pairs.pixel, pairs.light)
    out = {f"while LED {j} is lit": led == j for j in range(n_led)}
    for i, vertical in enumerate(ROWS):
        for j, horizontal in enumerate(COLUMNS):
            out[f"in the {vertical} {horizontal} of the object"] = (third[0] == i) & (third[1] == j)
    if len(span):
        out["in the dark"] = pairs.light <= np.quantile(pairs.light, END)
        out["where light is slow"] = span >= np.quantile(span, 1 - END)
        out["in highlights"] = pairs.light > (1 - END) * brightest[pairs.pixel]
    return out


def in_words(pairs: Slotted, where: dict[str, np.ndarray], noise: float) -> str:
    """Write the sentence."""
    shared = pairs.shared
    known = np.isfinite(shared)
    if np.count_nonzero(known) < FEWEST:
        return "too few events to tell"
    level = np.mean(shared[known])
    said = f"residuals that come again in every round are {_root(level):.2g} of a threshold, beside {noise:.2g} of all"
    found = []
    for name, place in where.items():
        here, there = shared[known & place], shared[known & ~place]
        if min(len(here), len(there)) < FEWEST:
            continue
        difference = np.mean(here) - np.mean(there)
        error = np.hypot(np.std(here) / len(here) ** 0.5, np.std(there) / len(there) ** 0.5)
        if difference > CLEAR * error and _root(np.mean(here)) > LARGER * _root(np.mean(there)):
            found.append((np.mean(here), f"{name} ({_root(np.mean(here)):.2g})"))
    if not found:
        return f"{said}, much alike everywhere"
    return f"{said}; they are larger " + ", ".join(name for _, name in sorted(found, reverse=True))


def in_common(share: float) -> str:
    """Say what residuals of neighbouring pixels have in common, see `solve.discrepancy`."""
    return f"what neighbouring pixels have in common of them is {share:.2g} of the noise of a pixel, and sigmas count it"


def _root(square: float) -> float:
    return float(np.sqrt(max(square, 0)))
