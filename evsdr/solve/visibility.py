"""Which LEDs each pixel sees, as its events tell: the best of many guesses, each with maps of its own.

Maps and visibility of a pixel explain each other: an LED that something hides looks like one behind the horizon, so a
fit that sees all LEDs turns the normal away from it. Guesses are compared where both are free. Hidden LEDs mostly make
one arc in azimuth: arcs are tried first, then what the neighbours found, and small changes of the best.
"""

from dataclasses import dataclass, replace

import drjit as dr
import numpy as np

from evsdr.frozen import no_garbage_collection
from evsdr.model.arrays import columns, owned
from evsdr.model.lambert import LambertianRing
from evsdr.solve.grid import NEXT, lonely_grid, nearest
from evsdr.solve.levenberg import descend
from evsdr.solve.loop import data_of, start_of
from evsdr.solve.pair_data import PairData, thin
from evsdr.solve.problem import Problem
from evsdr.solve.recipes import Effort
from evsdr.solve.solution import Solution
from evsdr.solve.stages import ALL_TERMS, PAIRS
from evsdr.solve.system import system_of
from evsdr.solve.unknowns import SLOPES, to_normal

# Costs are negative logarithms of likelihoods
SUSPECT = 8.0  # cost of a pixel beyond what is usual for its events, from which it may be shadowed; guessed
# Of each arc of LEDs that are hidden, or traced otherwise; guessed: 3 to 30 make no difference
ARC = 6.0
PARTIAL = 2.0  # of each LED that is seen in part, if not traced so; guessed: 1 and 3 make no difference
# Of each LED that is traced otherwise, on an estimated surface and on a known one; guessed
MISMATCH, MISTOLD = 1.5, 6.0
LENGTHS = 1 / 12, 1 / 6, 1 / 3, 1 / 2, 3 / 4  # of arcs, of the ring
N_BEGIN = 8  # places where arcs begin
SHARES = 0.2, 0.5, 0.8  # of LEDs at the ends of an arc
N_MOST = 48  # events of a pixel that count
N_PROBED = 200  # suspects, from the worst to the best, that tell whether it is worth a search
LEAST_EXPLAINED = 0.3  # share of their misfit that must go; measured: up to 0.22 where nothing new is hidden, above 0.4 else
MOST_SEARCHED = 1500  # pixels that try all arcs; others learn from these
N_ROUND = 4  # of small changes
AT_ONCE = 60_000  # guesses that are solved together
TOLERANCE = 0.1  # gain in log likelihood that is worth a step
SPARE = 1  # LEDs that must be lit beyond the number of unknowns; measured: with one, errors of 28 degrees, with two or more of 8
FACING = 0.05  # cosine from which a surface that faces an LED should be lit
# Softness of the horizon and steps, from what is known and from a frontal start
NEAR, FAR, SMALL = ((0.1, 5), (None, 4)), ((0.3, 5), (0.1, 3), (None, 4)), ((None, 4),)


@dataclass(frozen=True)
class Seen:
    """What pixels see of the LEDs.

    Attributes
    ----------
    share : (n_led, n_pixel) float32
        Visibility V, 0..1.
    theta : (n_pixel, n_unknown) float32
        The unknowns that go with it.
    untold : (n_pixel,) bool
        Where no more LEDs are lit than there are unknowns: any visibility explains the events there, and they tell nothing.
    gain : (n_pixel,) float, optional
        By how much the events are likelier than with the visibility that was given (difference of logarithms); 0 where
        that stays.
    explained : float
        Share of what the suspects' pairs cost beyond what is usual that this takes away.
    """

    share: np.ndarray
    theta: np.ndarray
    untold: np.ndarray
    gain: np.ndarray | None = None
    explained: float = 0.0

    def everywhere(self, pixel: np.ndarray, n_image: int) -> np.ndarray:
        """Give the visibility of all pixels of an image (n_led, n_image); those that are not solved see everything."""
        out = np.ones((len(self.share), n_image), np.float32)
        out[:, pixel] = self.share
        return out


@dataclass(frozen=True)
class Guess:
    """The best so far: visibility (n_led, n_pixel), unknowns (n_pixel, n_unknown) and cost (n_pixel)."""

    share: np.ndarray
    theta: np.ndarray
    cost: np.ndarray

    def better(self, pixel: np.ndarray, share: np.ndarray, theta: np.ndarray, cost: np.ndarray) -> "Guess":
        """Take over what costs less; a pixel may be named several times."""
        order = np.lexsort((cost, pixel))
        k = order[np.unique(pixel[order], return_index=True)[1]]
        k = k[cost[k] < self.cost[pixel[k]]]
        new = Guess(self.share.copy(), self.theta.copy(), self.cost.copy())
        new.share[:, pixel[k]], new.theta[pixel[k]], new.cost[pixel[k]] = share[:, k], theta[k], cost[k]
        return new


@dataclass(frozen=True)
class Judge:
    """Fits maps to guesses of the visibility, and tells what they cost.

    Attributes
    ----------
    problem : Problem
        Under light that nothing hides.
    pairs : PairData
        The events that count.
    solution : Solution
        For noise and thresholds.
    order : (n_led,) int
        LEDs by azimuth.
    traced : (n_led, n_pixel) float, optional
        What tracing says of the visibility.
    facing : (n_led, n_pixel) bool, optional
        Where that counts.
    known : bool
        Whether it was traced on a known surface.
    """

    problem: Problem
    pairs: PairData
    solution: Solution
    order: np.ndarray
    traced: np.ndarray | None = None
    facing: np.ndarray | None = None
    known: bool = False

    def prior(self, pixel: np.ndarray, share: np.ndarray) -> np.ndarray:
        """Give what guesses cost before any event is heard: for each departure from what is traced."""
        each = MISTOLD if self.known else MISMATCH
        off = 1 - share if self.traced is None else (self.traced[:, pixel] - share) * self.facing[:, pixel]
        ring = off[self.order]
        arcs = np.abs(ring - np.roll(ring, 1, axis=0)).sum(axis=0) / 2
        partial = (share > 0) & (share < 1) & (off != 0)
        cost = ARC * arcs + PARTIAL * partial.sum(axis=0)
        if self.traced is not None:
            cost += each * np.abs(off).sum(axis=0)
        return cost

    def __call__(self, pixel: np.ndarray, share: np.ndarray, theta: np.ndarray, descents: tuple) -> tuple:
        """Fit guesses: of pixels (n), visibilities (n_led, n), from unknowns (n, n_unknown); gives unknowns and costs."""
        theta, cost = self._fit(pixel, share, theta, descents, ALL_TERMS)
        return theta, cost + self.prior(pixel, share)

    def misfit(self, pixel: np.ndarray, guess: "Guess") -> np.ndarray:
        """Give what the pairs of pixels cost."""
        given = pixel, guess.share[:, pixel], guess.theta[pixel], ((None, 0),)
        return self._fit(*given, PAIRS)[1]

    @no_garbage_collection()
    def _fit(self, pixel, share, theta, descents, terms):
        parts = [slice(k, k + AT_ONCE) for k in range(0, len(pixel), AT_ONCE)]
        fitted = [self._fit_some(pixel[k], share[:, k], theta[k], descents, terms) for k in parts]
        cost = np.concatenate([[], *(c for _, c in fitted)])
        return np.concatenate([theta[:0], *(t for t, _ in fitted)]), cost

    def _fit_some(self, pixel, share, theta, descents, which):
        light, UInt32 = self.problem.illumination, type(self.pairs.first)
        Float = type(light.constant_light)
        index = owned(UInt32, pixel)
        model = LambertianRing(light.gather(index).seen(share))
        grid = lonely_grid(len(pixel), UInt32)
        width = Effort().width(self.solution.threshold_gain is not None)
        data = data_of(model, self.pairs.at(index), light.constant_light, grid, width)
        theta = columns(Float, theta)
        state = replace(start_of(data, theta, None, self.solution.threshold_prior), noise=self.solution.noise)
        for softness, n_step in descents:
            softness = dr.opaque(Float, light.horizon if softness is None else softness)
            system = system_of(data, replace(state, softness=softness), which.loss(data))
            theta, terms, *_ = descend(system, theta, n_step, TOLERANCE)
        return np.stack([t.numpy() for t in theta], axis=-1), terms[0].numpy()


def find_visibility(
    problem: Problem,
    solution: Solution,
    given: np.ndarray,
    traced: np.ndarray | None = None,
    known: bool = False,
) -> Seen:
    """Find what each pixel sees.

    Parameters
    ----------
    problem : Problem
        Under light that nothing hides.
    solution : Solution
        What was fitted so far.
    given : (n_led, n_pixel) float
        Visibility so far.
    traced : (n_led, n_pixel) float, optional
        What tracing says of it.
    known : bool
        Whether that was on a known surface, not on an estimated one.

    Returns
    -------
    Seen
    """
    direction = np.array([[np.mean(c.numpy()) for c in d] for d in problem.illumination.direction])
    order = np.argsort(np.arctan2(direction[:, 1], direction[:, 0]), kind="stable")
    faces = None if traced is None else facing(problem, solution.theta)
    judge = Judge(problem, thin(problem.pairs, N_MOST), solution, order, traced, faces, known)
    pixel, share = np.arange(problem.n_pixel), np.asarray(given, np.float32)
    first = Guess(share, *judge(pixel, share, solution.all_theta, ((None, 8),)))
    count, paid = judge.pairs.counts, judge.misfit(pixel, first)
    usual = np.median((paid / np.maximum(count, 1))[count > 0]) * count if count.any() else count
    excess = paid - usual
    pixel = suspected = suspects(judge, first, excess)
    none = np.zeros(problem.n_pixel)
    if len(pixel) == 0:
        return Seen(share, solution.all_theta, none > 0, none)

    def explained(guess: Guess, among: np.ndarray) -> float:
        after = judge.misfit(among, guess) - usual[among]
        return float(1 - _positive(after) / max(_positive(excess[among]), 1))

    best = first
    if known or (share == 1).all():
        some = np.sort(_some(pixel[np.argsort(-excess[pixel], kind="stable")], N_PROBED))
        probe = _try_arcs(judge, _try_traced(judge, first, some), some)
        for _ in range(N_ROUND):
            probe = _try_changes(judge, probe, some)
        if explained(probe, some) < LEAST_EXPLAINED:
            return Seen(share, solution.all_theta, none > 0, none)
        best = _try_arcs(judge, first, pixel)
    best = _try_traced(judge, best, pixel)
    for _ in range(N_ROUND):
        last = best
        best = _try_neighbours(judge, _try_changes(judge, best, pixel), pixel)
        pixel = pixel[best.cost[pixel] < last.cost[pixel] - TOLERANCE]
        if len(pixel) == 0:
            break
    same = (best.share == share).all(axis=0)
    theta = np.where(same[:, None], solution.all_theta, best.theta)
    blank = untold(problem, best.share, theta) & (not known)
    gain = np.where(same, 0, first.cost - best.cost)
    return Seen(best.share, theta, blank, gain, explained(best, suspected))


def _some(pixel: np.ndarray, most: int) -> np.ndarray:
    """Choose at most so many pixels, evenly."""
    return pixel[:: -(-len(pixel) // most)]


def _positive(excess: np.ndarray) -> float:
    return float(np.maximum(excess, 0).sum())


def facing(problem: Problem, theta: np.ndarray) -> np.ndarray:
    """Tell which LEDs (n_led, n_pixel) the surface faces, by its normals."""
    normal = to_normal(theta)
    direction = (
        np.stack([np.broadcast_to(c.numpy(), len(normal)) for c in d]) for d in problem.illumination.direction
    )
    return np.array([np.einsum("kn,nk->n", d, normal) > FACING for d in direction])


def untold(problem: Problem, share: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Tell in which pixels some LEDs are hidden and no more are lit than there are unknowns, and a few to spare."""
    lit = facing(problem, theta) & (share >= 0.5)
    n_map = problem.illumination.n_band + 2
    return (share < 0.5).any(axis=0) & (lit.sum(axis=0) <= n_map + SPARE)


def suspects(judge: Judge, guess: Guess, excess: np.ndarray) -> np.ndarray:
    """Give the pixels whose pairs cost more than is usual, or that are shadowed already, or traced so."""
    out = excess > SUSPECT
    if not judge.known:
        out |= (guess.share < 1).any(axis=0)
        if judge.traced is not None:
            out |= ((judge.traced < 1) & judge.facing).any(axis=0)
    return np.flatnonzero(out & (judge.pairs.counts > 0))


def arcs(order: np.ndarray) -> np.ndarray:
    """Give visibilities (n_arc, n_led) with one arc of hidden LEDs; in the first all are seen."""
    n_led = len(order)
    out = [np.ones(n_led, np.float32)]
    for length in sorted({max(1, round(share * n_led)) for share in LENGTHS} - {n_led}):
        for begin in range(0, n_led, max(1, n_led // N_BEGIN)):
            seen = np.ones(n_led, np.float32)
            seen[order[(begin + np.arange(length)) % n_led]] = 0
            out.append(seen)
    return np.array(out)


def changes(share: np.ndarray) -> list[np.ndarray]:
    """Give small changes of visibilities (n_led, n), LEDs in order of azimuth."""
    before, after = np.roll(share, 1, axis=0), np.roll(share, -1, axis=0)
    out = [choose(share, other) for choose in (np.minimum, np.maximum) for other in (before, after)]
    for other in (before, after):
        for dim in (share < 0.5) & (other >= 0.5), (share >= 0.5) & (other < 0.5):
            out += [np.where(dim, np.float32(part), share) for part in SHARES]
    size = max(1, len(share) // 24)
    for begin in range(0, len(share), size):
        flipped = share.copy()
        flipped[begin : begin + size] = share[begin : begin + size] < 0.5
        out.append(flipped)
    return out


def _try_arcs(judge: Judge, best: Guess, pixel: np.ndarray) -> Guess:
    """Try arcs in some pixels, from what is known and from frontal normals; others then learn of the nearest of these."""
    some = _some(pixel, MOST_SEARCHED)
    guesses = arcs(judge.order)
    for theta, descents in _starts(best):
        for part in np.array_split(guesses, max(1, len(guesses) * len(some) // AT_ONCE)):
            here, share = np.tile(some, len(part)), np.repeat(part, len(some), axis=0).T
            best = best.better(here, share, *judge(here, share, theta[here], descents))
    return _learn_from(judge, best, np.setdiff1d(pixel, some), some) if len(some) < len(pixel) else best


def _try_traced(judge: Judge, best: Guess, pixel: np.ndarray) -> Guess:
    """Try what is traced."""
    if judge.traced is not None:
        share = judge.traced[:, pixel]
        for theta, descents in _starts(best):
            best = best.better(pixel, share, *judge(pixel, share, theta[pixel], descents))
    return best


def _starts(best: Guess) -> tuple:
    """Give unknowns to start from, and how to descend: what is known, and frontal normals."""
    flat = np.tile(np.median(best.theta, axis=0), (len(best.theta), 1)).astype(np.float32)
    flat[:, SLOPES] = 0
    return (best.theta, NEAR), (flat, FAR)


def _learn_from(judge: Judge, best: Guess, pixel: np.ndarray, teachers: np.ndarray) -> Guess:
    """Let pixels try what the nearest teacher found."""
    taught = np.zeros(len(best.cost), bool)
    taught[teachers] = True
    other = nearest(taught, judge.problem.grid.mask)[pixel]
    return best.better(
        pixel, best.share[:, other], *judge(pixel, best.share[:, other], best.theta[other], NEAR)
    )


def _try_changes(judge: Judge, best: Guess, pixel: np.ndarray) -> Guess:
    """Try small changes of what is best."""
    back = np.argsort(judge.order)
    new = changes(best.share[judge.order][:, pixel])
    per = max(1, AT_ONCE // len(pixel))
    for k in range(0, len(new), per):
        share = np.concatenate(new[k : k + per], axis=1)[back]
        here = np.tile(pixel, share.shape[1] // len(pixel))
        differs = (share != best.share[:, here]).any(axis=0)
        here, share = here[differs], share[:, differs]
        best = best.better(here, share, *judge(here, share, best.theta[here], SMALL))
    return best


def _try_neighbours(judge: Judge, best: Guess, pixel: np.ndarray) -> Guess:
    """Try what the four neighbours found."""
    links = judge.problem.grid.links
    for place in NEXT:
        other = links.index[place].numpy().astype(np.int64)[pixel]
        differs = (best.share[:, other] != best.share[:, pixel]).any(axis=0)
        here, other = pixel[differs], other[differs]
        share = best.share[:, other]
        best = best.better(here, share, *judge(here, share, best.theta[other], SMALL))
    return best
