"""The outline of an object whose shape no scene and no mask tells: what fires, and what that encloses."""

from dataclasses import replace

import numpy as np
from scipy import ndimage

from evsdr.effects.effect import Decision
from evsdr.effects.surface import FittedSurface
from evsdr.effects.world import Fitted, World
from evsdr.events.chosen import count_events

# Events of a pixel that is lit: one a round, and so many. Of chance a pixel of an EVK4 has 0.1 a second; all below are guessed
FEWEST = 5
GAP = 2  # dark pixels between lit ones [pixels]
MOST = 4  # times that many of a pixel count: hot ones fire thousands
# Of the pixels of a mask, that are dark around what is lit, from which it is drawn too loosely; measured on Nefertiti at 96 x 96:
# 41 % cost nothing, 71 % half as much again of the error
LOOSE = 0.5
DARK = 0.15  # of the events of a lit pixel, that those around have on average, else they come from everywhere


def outline(count: np.ndarray, mask: np.ndarray, n_round: int) -> np.ndarray:
    """Keep the masked pixels (height, width) bool that are lit, with what they enclose.

    Parameters
    ----------
    count : (height, width) int
        Events of each pixel.
    mask : (height, width) bool
    n_round : int
        Rounds of the ring.

    Returns
    -------
    (height, width) bool
        All of the mask, where events do not tell what is lit.
    """
    count, rim, fewest = np.where(mask, count, 0), 2 * GAP, max(FEWEST, n_round)
    lit = np.pad(count >= fewest, rim)
    near = ndimage.iterate_structure(ndimage.generate_binary_structure(2, 1), GAP)
    whole = ndimage.binary_fill_holes(ndimage.binary_closing(lit, near))
    kept, count = mask & whole[rim:-rim, rim:-rim], np.minimum(count, MOST * fewest)
    dark = mask & ~kept
    return kept if kept.any() and dark.any() and count[dark].mean() < DARK * count[kept].mean() else mask


class Outline:
    """Leave out what stays dark around an object, where a rectangle stands for its shape and no mask tells its pixels.

    Of such pixels silence is all that is known. They are many, and of thresholds silence only tells that they are not small.
    """

    name, option, when = "outline", "", "first"

    def decide(self, asked: str, world: World, fitted: Fitted | None) -> Decision | None:
        """Look at which pixels fire."""
        if world.ring.shape_is_known:
            return None
        n_round = len(world.recording.round_start_us) - 1
        kept = outline(count_events(world.recording.events, world.mask.shape), world.mask, n_round)
        n, dark = np.count_nonzero(world.mask), np.count_nonzero(world.mask & ~kept)
        if world.surface.bounded:
            return self.of_mask(dark / n)
        if not dark:
            return Decision(
                self.name, False, "none: of the rectangle that stands for the object all pixels may be lit"
            )
        why = f"as events show it: {dark} of {n} pixels stay dark around the object, and are left out"
        return Decision(self.name, True, why, found={"pixels": int(dark)}, answer=kept)

    def of_mask(self, share: float) -> Decision:
        """Let a mask be, whatever share of it is dark; but silence of what is not the object passes for large thresholds."""
        why = f"that of the mask, of whose pixels {share:.0%} stay dark around what is lit"
        doubt = f"{share:.0%} of the pixels of the mask stay dark around what fires; if they are not of the object, draw it closer, or leave --mask out."
        return Decision(self.name, False, why, found={"dark": share}, doubt=doubt if share > LOOSE else "")

    def model(self, world: World, decision: Decision) -> World:
        """Solve what it holds."""
        return replace(world, mask=decision.answer, surface=FittedSurface(world.ring))
