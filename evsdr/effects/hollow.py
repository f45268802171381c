"""Half a turn of image or ring makes a raised surface hollow and leaves no curl: only shadows tell one from the other."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from evsdr.effects.doubts import LEAST_PLACES, VARIED_DEG
from evsdr.effects.hypotheses import Finding, Hypothesis, half_turn, opposite
from evsdr.effects.trials import chosen, try_all
from evsdr.records import Maps

if TYPE_CHECKING:
    from evsdr.effects.world import Fitted, World

FEWEST = 20  # pixels that can convict
N_SHADED = 400  # pixels that tell shadows, which few have
# Cost of an event pair that tells hollow from raised; measured: reliefs 0.014 to 0.036, spheres and bumpy meshes 3
HOLLOW = 0.005
LITTLE = 0.1  # of that, what the better of both may lose against no shadows at all; guessed: 0.005 beside a pole's shadows
# Cost of an event pair by which the shadows of half a turn are nearer to the truth, though they may lose against none, from which what is told is in
# doubt. Measured on the unknown shapes of 30 draws (`experiments.draws`), right and turned by 180 degrees: right -2.9 to .011, but .137 of a white goathead in
# two rounds; turned .029 to 1.84, but 0 of a low relief, -.002 and -.034 of goatheads under powers 10 % off
NEARER = 0.02
SURE = 0.5  # pixels: nearer hits of a surface on itself may come of its noise
OPEN = (
    "no shadow tells a raised surface from a hollow one, which half a turn of image or ring would make of it"
)
DOUBT = (
    "the events lack the shadows of the fitted surface; image or ring may be turned by 180 degrees, so that raised and hollow "
    "change places: look whether the surface is raised where it should be, and turn CD/events or schedule/order if it is not."
)


@dataclass(frozen=True)
class Hollow:
    """What shadows say of half a turn, which makes a raised surface hollow and leaves no curl.

    Attributes
    ----------
    told, turned, bare : float
        Cost of an event pair in the shadows of the surface as told, of that half a turn away, and without any.
    """

    told: float
    turned: float
    bare: float

    @property
    def gain(self) -> float:
        """Give what the turned one gains."""
        return self.told - self.turned

    @property
    def lacking(self) -> bool:
        """Whether the events lack the shadows of what is told, and rather have those of the other."""
        return self.gain > HOLLOW and self.told > self.bare

    @property
    def wrong(self) -> bool:
        """Whether the events show the shadows of the other."""
        return self.lacking and self.bare - self.turned > HOLLOW

    @property
    def doubtful(self) -> bool:
        """Whether they lack those of what is told, which noisy normals may have made, and agree with the other, or do so far better."""
        agree = self.turned - self.bare < LITTLE * self.gain
        return not self.wrong and self.lacking and (agree or self.gain > NEARER)

    @property
    def open(self) -> bool:
        """Whether they tell neither."""
        return not (self.wrong or self.doubtful) and self.gain > -HOLLOW

    def finding(self, world: "World") -> Finding | None:
        """Give half a turn if that is it."""
        if not self.wrong:
            return None
        evidence = (
            "with that, raised and hollow change places, and the shadows of the fitted surface explain the events better by "
            f"{self.gain:.2g} of log likelihood an event"
        )
        other = opposite(world.recording.schedule.order, world.ring.leds.n_led)
        return Finding(half_turn(world.recording), evidence, (other,) if other else ())


def told_by_shadows(world: "World", fitted: "Fitted") -> Hollow | None:
    """Ask shadows whether an unknown shape is hollow or raised, or remember it; None of what is flat or too small to tell."""
    return world.memo("hollow", (fitted,), lambda: _told_by_shadows(world, fitted))


def _told_by_shadows(world: "World", fitted: "Fitted") -> Hollow | None:
    maps = fitted.maps
    if world.ring.shape_is_known or np.count_nonzero(maps.mask) < LEAST_PLACES:
        return None
    if np.degrees(np.sqrt(np.var(maps.normal[maps.mask], axis=0).sum())) < VARIED_DEG:
        return None
    half = half_turn(world.recording)
    pixel = chosen(world, fitted, [half.move], N_SHADED)
    if len(pixel) < FEWEST:
        return None
    bare = try_all(world, fitted, pixel, [None, half])
    if half not in bare:  # the object lies elsewhere then
        return None
    costs = (shadow_cost(world, fitted, pixel, h, moved(maps, h)) for h in (None, half))
    return Hollow(*costs, min(trial.cost for trial in bare.values()))


def moved(maps: Maps, hypothesis: Hypothesis | None) -> Maps:
    """Give the maps of an image that is moved."""
    if hypothesis is None:
        return maps
    normal, mask = (np.ascontiguousarray(hypothesis.move(a)) for a in (maps.normal, maps.mask))
    return replace(maps, normal=normal, mask=mask)


def shadow_cost(
    world: "World", fitted: "Fitted", pixel: np.ndarray, hypothesis: Hypothesis | None, maps: Maps
) -> float:
    """Give what an event pair costs in the shadows of the surface that a hypothesis makes of a fit; None is what is told."""
    light = world.trace(True, 1, replace(fitted, maps=maps), SURE)
    return try_all(world, fitted, pixel, [hypothesis], light)[hypothesis].cost
