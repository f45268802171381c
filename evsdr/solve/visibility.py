"""Which LEDs each pixel sees, as its events tell: the best of many guesses, each with maps of its own.

Maps and visibility of a pixel explain each other: an LED that something hides looks like one behind the horizon, so a
fit that sees all LEDs turns the normal away from it. Guesses are compared where both are free. Hidden LEDs mostly make
one arc in azimuth: arcs are tried first, then what the neighbours found, and small changes of the best.
"""

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from evsdr.progress import never
from evsdr.solve.coarse import lattice
from evsdr.solve.grid import NEXT, beside, nearest
from evsdr.solve.guesses import AT_ONCE, N_CHANGE, TOLERANCE, Guess, Judge, arcs, changes
from evsdr.solve.pair_data import thin
from evsdr.solve.problem import Problem
from evsdr.solve.solution import Solution
from evsdr.solve.unknowns import SLOPES, apart, to_normal

SUSPECT = 8.0  # cost of a pixel beyond what is usual for its events, from which it may be shadowed; guessed
# Times the noise, under which arcs are compared at first: theirs are hard edges, and seen as closely as events tell, the right
# one costs as much as any until its edges are soft (graduated non-convexity). Measured on the lion at 64 pixels: without
# 6.2 degrees, with 5.6, and from 8 on 5.7
ROUGHLY = 4.0, 2.0
# Times the noise, under which guesses are as likely as sigmas count them: what events have beside the model speaks for or against
# a guess as noise does. Measured at 64 pixels, pixels within 1, 2, 3 sigma: goathead 79 90 96 % without, 87 95 98 with; lion
# 62 83 91 and 67 87 94; with 5.5 89 97 99 and 71 91 96
OPEN = 4.0
N_MOST = 48  # events of a pixel that count
# Suspects, from the worst to the best, that tell whether it is worth a search, and places where arcs begin in them
N_PROBED, PROBED_BEGIN = 200, 8
LEAST_EXPLAINED = 0.3  # share of their misfit that must go; measured: up to 0.22 where nothing new is hidden, above 0.4 else
ENOUGH = 1500  # pixels that try all arcs, and up to four times as many; others learn from these; guessed
N_ROUND = 4  # of small changes
# Guesses of a pixel, of arcs and of changes, that are fitted well. Measured: of all 121 arcs 12 do as well; 12 of the changes in place
# of all 47 cost a blob's shadowed pixels nothing, those of a skull 1 to 2 in log likelihood; mean errors of a skull, a goathead, a lion, a
# relief at 64 pixels 2.63 2.03 5.25 1.19 -> 2.67 2.08 5.41 1.17 degrees, in half the time
MOST_ARCS, MOST_CHANGES = 12, 12
SPARE = 1  # LEDs that must be lit beyond the number of unknowns; measured: with one, errors of 28 degrees, with two or more of 8
# At the edge of a shadow rays tell badly how little is seen of an LED, and log I hangs on it: a pixel's scale came out at half or
# twice of what it is. Left out are events under at most so many LEDs that are seen by less than that, where each band keeps so many
# that are seen whole. Measured on a sphere and its pole at 160 pixels: RMSE of R 0.0076 -> 0.0032, 0.38 % of the pixels beyond six
# sigma -> 0.02 %; reliefs and a skull of known shape lose by more LEDs or by parts above a half
DEEP, MOST_DOUBTFUL, WHOLE = 0.5, 2, 2
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


def find_visibility(
    problem: Problem,
    solution: Solution,
    given: np.ndarray,
    traced: np.ndarray | None = None,
    known: bool = False,
    enough: Callable[[], bool] = never,
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
    enough : callable () -> bool
        Says whether to end soon, with the best so far.

    Returns
    -------
    Seen
    """
    judge = replace(_judge(problem, solution, traced, known), enough=enough)
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
        # arcs with hard edges, though half of the soft ones are missed so: with soft ones, gloss passes for shadow
        probe = _try_arcs(judge, _try_traced(judge, first, some), some, arcs(judge.order, PROBED_BEGIN))
        for _ in range(N_ROUND):
            probe = _try_changes(judge, probe, some)
        if explained(probe, some) < LEAST_EXPLAINED:
            return Seen(share, solution.all_theta, none > 0, none)
        best = _try_roughly(judge, first, pixel)
    best = _follow(judge, _try_traced(judge, best, pixel), pixel)
    same = (best.share == share).all(axis=0)
    theta = np.where(same[:, None], solution.all_theta, best.theta)
    blank = untold(problem, best.share, theta) & (not known)
    gain = np.where(same, 0, first.cost - best.cost)
    return Seen(best.share, theta, blank, gain, explained(best, suspected))


def unhide(
    problems: list[Problem],
    solution: Solution,
    given: np.ndarray,
    traced: np.ndarray | None = None,
    known: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """Let pixels see all LEDs where the events are as likely so: a lobe lights LEDs up, and a matt model takes the others for hidden.

    Parameters
    ----------
    problems : list of Problem
        Under light that nothing hides, with lobes: those that are believed, and others that a pixel may have if nothing is
        hidden from it.
    others
        As of `find_visibility`.

    Returns
    -------
    share : (n_led, n_pixel) float32
        Visibility V, 0..1.
    theta : (n_pixel, n_unknown) float32
        The unknowns that go with it; those of the solution where nothing changes.
    """
    judges = [_judge(problem, solution, traced, known) for problem in problems]
    share, hidden = np.asarray(given, np.float32), (given < 1).any(axis=0)
    pixel = np.flatnonzero(hidden & (judges[0].pairs.counts > 0))
    if len(pixel) == 0:
        return share, solution.all_theta
    unknown = Guess(share, solution.all_theta, np.full(problems[0].n_pixel, np.inf))
    best = unknown.better(
        pixel, share[:, pixel], *judges[0](pixel, share[:, pixel], unknown.theta[pixel], NEAR)
    )
    free, starts = np.ones((len(share), len(pixel)), np.float32), _starts(unknown)
    if not hidden.all():
        starts += ((unknown.theta[nearest(~hidden, problems[0].grid.mask)], NEAR),)
    for judge, (theta, descents) in itertools.product(judges, starts):
        best = best.better(pixel, free, *judge(pixel, free, theta[pixel], descents))
    changed = (best.share != share).any(axis=0)
    return best.share, np.where(changed[:, None], best.theta, solution.all_theta)


def left_open(
    problem: Problem, solution: Solution, given: np.ndarray, traced: np.ndarray, known: bool
) -> np.ndarray:
    """Give the covariances (n_pixel, n_map, n_map) of maps that not knowing the visibility leaves open.

    What a pixel sees, what each neighbour sees, and what is traced, are guesses: under each the pixel's own events give it
    maps. By how likely these are, their squared distance from the solution is averaged: it counts how far apart guesses are,
    and how far neighbours hold the pixel from what its own events say. Events that are explained badly tell less.
    Arguments as of `find_visibility`; `given` is the visibility of the solution.
    """
    judge, theta = _judge(problem, solution, traced, known), solution.all_theta
    pixel = np.flatnonzero(judge.pairs.counts > 0)
    guesses = [(pixel, given[:, pixel], theta[pixel])]
    other = pixel[(given[:, pixel] != traced[:, pixel]).any(axis=0)]
    guesses.append((other, traced[:, other], theta[other]))
    for place in problem.grid.links.index.values():
        other = place.numpy().astype(np.int64)[pixel]
        differs = (given[:, other] != given[:, pixel]).any(axis=0)
        guesses.append((pixel[differs], given[:, other[differs]], theta[other[differs]]))
    here, share, start = (np.concatenate(parts, axis=k) for parts, k in zip(zip(*guesses), (0, 1, 0)))
    found, cost = judge(here, share, start, NEAR)
    least = np.full(problem.n_pixel, np.inf)
    np.minimum.at(least, here, cost)
    odds = np.exp(-(cost - least[here]) / np.square(OPEN * np.maximum(solution.noise_factor[here], 1)))
    odds /= np.bincount(here, odds, problem.n_pixel)[here]
    n_map = solution.theta.shape[1]
    out = np.zeros((problem.n_pixel, n_map, n_map))
    np.add.at(out, here, odds[:, None, None] * apart(solution.theta[here], found[:, :n_map]))
    return out


def _judge(problem: Problem, solution: Solution, traced: np.ndarray | None, known: bool) -> Judge:
    direction = np.array([[np.mean(c.numpy()) for c in d] for d in problem.illumination.direction])
    order = np.argsort(np.arctan2(direction[:, 1], direction[:, 0]), kind="stable")
    faces = None if traced is None else facing(problem, solution.theta)
    return Judge(problem, thin(problem.pairs, N_MOST), solution, order, traced, faces, known)


def doubtful(share: np.ndarray, band: list[int]) -> np.ndarray:
    """Tell of which LEDs (n_led, n_pixel) a little is seen, and how little is told badly: share as traced, 0..1."""
    little, whole = (share > 0) & (share < DEEP), share == 1
    left = np.min([whole[np.equal(band, b)].sum(axis=0) for b in range(max(band) + 1)], axis=0)
    return little & (left >= WHOLE) & (little.sum(axis=0) <= MOST_DOUBTFUL)


def _some(pixel: np.ndarray, most: int) -> np.ndarray:
    """Choose at most so many pixels, evenly."""
    return pixel[:: -(-len(pixel) // most)]


def _parts(pixel: np.ndarray, n_guess: int) -> list[np.ndarray]:
    """Take pixels apart, so that all guesses of a part are solved together."""
    return np.array_split(pixel, max(1, len(pixel) * n_guess // AT_ONCE))


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


def _try_arcs(judge: Judge, best: Guess, pixel: np.ndarray, guesses: np.ndarray) -> Guess:
    """Try arcs, from what is known and from frontal normals."""
    for (theta, descents), some in itertools.product(_starts(best), _parts(pixel, len(guesses))):
        if judge.enough():
            break
        here, share = np.tile(some, len(guesses)), np.repeat(guesses, len(some), axis=0).T
        best = best.better(*judge.race(here, share, theta[here], descents, MOST_ARCS))
    return best


def _try_roughly(judge: Judge, best: Guess, pixel: np.ndarray) -> Guess:
    """Try arcs under noise that counts as larger, and follow the best of them to the noise as it is.

    In pixels of a lattice where there are many; others then learn of the nearest of these.
    """
    every = max(1, int(np.sqrt(len(pixel) / ENOUGH)))
    some = pixel[lattice(judge.problem.grid.mask, every)[pixel]]
    guess = best
    for factor in ROUGHLY:
        rough, share = judge.rougher(factor), guess.share[:, some]
        unknown = replace(guess, cost=np.full(len(guess.cost), np.inf))
        guess = unknown.better(some, share, *rough(some, share, guess.theta[some], NEAR))
        if factor == ROUGHLY[0]:
            guess = _try_arcs(rough, guess, some, arcs(judge.order))
        guess = _follow(rough, guess, some, every)
    share = guess.share[:, some]
    best = best.better(some, share, *judge(some, share, guess.theta[some], NEAR))
    return _learn_from(judge, best, np.setdiff1d(pixel, some), some) if len(some) < len(pixel) else best


def _follow(judge: Judge, best: Guess, pixel: np.ndarray, every: int = 1) -> Guess:
    """Make small changes, and try what neighbours found, so many pixels away, as long as either helps."""
    for _ in range(N_ROUND):
        last = best
        best = _try_neighbours(judge, _try_changes(judge, best, pixel), pixel, every)
        pixel = pixel[best.cost[pixel] < last.cost[pixel] - TOLERANCE]
        if len(pixel) == 0 or judge.enough():
            break
    return best


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
    for some in _parts(pixel, N_CHANGE):
        if judge.enough():
            break
        new = changes(best.share[judge.order][:, some])
        here, share = np.tile(some, len(new)), np.concatenate(new, axis=1)[back]
        differs = (share != best.share[:, here]).any(axis=0)
        here, share = here[differs], share[:, differs]
        best = best.better(*judge.race(here, share, best.theta[here], SMALL, MOST_CHANGES))
    return best


def _try_neighbours(judge: Judge, best: Guess, pixel: np.ndarray, every: int) -> Guess:
    """Try what the four neighbours found, so many pixels away."""
    for place in NEXT:
        other = beside(judge.problem.grid.mask, place, every)[pixel]
        there = other >= 0
        here, other = pixel[there], other[there]
        differs = (best.share[:, other] != best.share[:, here]).any(axis=0)
        here, other = here[differs], other[differs]
        share = best.share[:, other]
        best = best.better(here, share, *judge(here, share, best.theta[other], SMALL))
    return best
