"""What all pixels share is inferred, and their maps move with it: from first maps and sketches, and anew under another light."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from evsdr.effects.blocks import sample_of
from evsdr.effects.shared import RAN_AWAY, SharedFound, find_shared, last_found
from evsdr.effects.world import Fitted, World
from evsdr.fitting import deciding
from evsdr.fitting.decoder import Decoder
from evsdr.fitting.settings import Settings
from evsdr.progress import Progress

MOST_SKETCHES = 2  # each under what the maps before tell that pixels share
FEW = 1000  # pixels that show whether what is inferred explains them, where there is one look only; guessed
KEPT = 0.5  # of the pixels that are known, at least, when what they share was inferred; guessed
FAR = 2.0  # limits by which better maps must turn normals, by what pixels share, to be worth another fit; guessed
# The same of the logarithms of reflectances and thresholds; guessed. Measured on a blob of experiments.table1 after its lobe was
# found: 0.05, RMSE 0.030 -> 0.010
RESCALED = 0.02


class Look(NamedTuple):
    """What pixels share, as some maps tell it.

    Attributes
    ----------
    told, world : World
        What was believed before, and what is now.
    found : SharedFound, optional
    before : Fitted
        Maps of the pixels that are sketched, moved with what was found.
    after : Fitted, optional
        The sketch; none where all is as told, or as it was found before.
    anew : bool
        Whether these maps were begun anew.
    """

    told: World
    world: World
    found: SharedFound | None
    before: Fitted
    after: Fitted | None
    anew: bool = False

    @property
    def noise(self) -> float:
        """Scatter of the events about the sketch; none leaves all."""
        return self.after.solution.noise if self.after else np.inf

    @property
    def next(self) -> tuple[World, Fitted]:
        """What the next look starts from."""
        return replace(self.told, found=self.found), replace(self.after, problem=self.before.problem)


@dataclass(frozen=True)
class Sketcher:
    """Looks at what maps tell that pixels share, and sketches them under that: all, or `few` of them."""

    settings: Settings
    solve: Decoder
    progress: Progress
    few: int | None = None

    def look(self, told: World, teacher: Fitted, first: bool = True) -> Look:
        """Ask some maps; of any but the first look more is asked to be worth a sketch.

        Powers farther off than any ring's may be those of maps that a lag bent: maps begun anew under powers as told, but all else as found, are asked,
        too, and stand if sketches explain the events better. Measured (`experiments.draws`, 1083, a steep plane that six LEDs do not reach): powers up
        to 134 % off leave a scatter of .13, 8.7 degrees; the others .08.
        """
        look = self._once(told, teacher, first)
        if look.after is None or told.metal is not None or not ran_away(look.found):
            return look
        rest = replace(look.world, aim=told.aim, mask=look.before.problem.grid.mask)
        anew = self.solve(rest.problem(look.before), None, "rough", self.progress)
        as_told = replace(told, found=with_powers_as_told(look.found))
        other = self._once(as_told, replace(anew, problem=look.before.problem))
        return other._replace(anew=True) if other.noise < look.noise else look

    def _once(self, told: World, teacher: Fitted, first: bool = True) -> Look:
        """Ask these maps only."""
        new, changed = deciding.decide("alone", told, teacher, self.settings, self.progress)
        found = find_shared(told, teacher) if changed else None  # nothing is inferred for who stopped
        if not changed or not (first or moves_far(found, told)):
            return Look(told, new, found, teacher, None)
        before = moved_with(found, teacher)
        before = sample_of(before, self.few) if self.few else before
        world = replace(new, mask=before.problem.grid.mask)
        return Look(
            told, new, found, before, self.solve(world.problem(before), before, "sketch", self.progress)
        )


def settle_events(
    world: World, fitted: Fitted, settings: Settings, solve: Decoder, progress: Progress
) -> tuple[World, Fitted]:
    """Infer what pixels share, from rough maps and from sketches under what those before tell.

    Where pixels are many they are some. Maps of pixels by which that is inferred move with it, and the others' alike. All are
    sketched under it where the maps shall tell what shape casts shadows.
    """
    sketcher, told, teacher = Sketcher(settings, solve, progress), world, sample_of(fitted)
    sketch, anew = None, False
    for turn in range(MOST_SKETCHES):
        look = sketcher.look(told, teacher, turn == 0)
        lost = look.after and loses(look.before, look.after)
        if lost or not look.after:
            first = refuse(told, look.world) if lost else look.world
            world = world if sketch else first
            break
        world, sketch, anew, (told, teacher) = look.world, look.after, anew or look.anew, look.next
        fitted = moved_with(look.found, fitted)
    if sketch and sketch.problem.n_pixel == fitted.problem.n_pixel:
        return world, sketch
    if anew:
        fitted = solve(world.problem(fitted), None, "rough", progress)
    elif sketch and world.ring.shape_is_known:
        return world, fitted
    return world, solve(world.problem(fitted), fitted, "sketch", progress)


def settle_events_at_once(
    world: World, fitted: Fitted, settings: Settings, solve: Decoder, progress: Progress
) -> tuple[World, Fitted]:
    """Infer what pixels share from rough maps, and let those move with it; sketches of a few pixels show whether that explains them.

    Where LEDs are not as told maps were bent by that, and the sketches are asked once more. Measured in fast fits of `experiments.draws` whose powers
    were 10 % off: 16, 24, 6, 4 18.3 7.9 6.7 14.9 -> 9.9 3.4 4.9 11.6 degrees, 21 6.2 -> 7.3, of 14 more none by more than scatter.
    """
    look = Sketcher(settings, solve, progress, FEW).look(world, fitted)
    if not look.after:
        return look.world, fitted
    if loses(look.before, look.after):
        return refuse(world, look.world), fitted
    new, moved = look.world, moved_with(look.found, fitted)
    if look.anew:
        moved = solve(new.problem(fitted), None, "search", progress)
    moved = replace(moved, solution=replace(moved.solution, noise=look.noise))
    if new.aim is world.aim:
        return new, moved
    told, teacher = look.next
    new, _ = deciding.decide("alone", told, teacher, settings, progress)
    return new, moved_with(find_shared(told, teacher), moved)


def share_anew(
    told: World, world: World, fitted: Fitted, settings: Settings, progress: Progress
) -> tuple[World, Fitted, bool]:
    """Infer what pixels share once more, now that the light's model is another; `told` is the world before any was inferred.

    Gives also whether that asks for another fit. It starts from what was found last, as maps are of that. Measured on a sphere (`experiments.draws`,
    --seeds 587 --but power=0 slot_us=15000 crossfade=1 perspective=False event_noise=.02 refractory_us=20 told_threshold=1): from what is told, which is
    LEDs .67 too far for these maps, departures took up what was wrong, and normals went from .3 to 8 degrees off.
    """
    same = world, fitted, False
    if not world.terms.shared:  # what follows would look for hidden LEDs once more
        return same
    as_told = {name: getattr(told, name) for name in ("recording", "lag", "leak", "aim", "nearer")}
    last = last_found(world.decisions)
    before = replace(world, found=last and replace(last, off=None), **as_told)
    looked = before.with_seen(fitted)
    teacher = replace(looked, problem=before.problem(looked))
    new, changed = deciding.decide("alone", before, teacher, settings, progress)
    if new is before:  # as told to stop
        return same
    found = find_shared(before, teacher)
    if not changed and not moves_far(found, world):
        return same
    return new, moved_with(found, looked), True


def ran_away(found: SharedFound | None) -> bool:
    """Tell whether powers are farther from what is told than those of any ring."""
    return found is not None and bool(
        (np.abs(found.inferred.rig.log_power) > RAN_AWAY * found.told.powers).any()
    )


def with_powers_as_told(found: SharedFound) -> SharedFound:
    """Start the next search with powers as told."""
    rig = found.searched or found.inferred.rig
    return replace(found, searched=replace(rig, log_power=np.zeros_like(rig.log_power)), off=None)


def loses(before: Fitted, after: Fitted) -> bool:
    """Say whether another fit knows too few of the pixels that one knew."""
    known = before.maps.mask[before.problem.grid.mask]
    return np.count_nonzero(known & after.maps.mask[before.problem.grid.mask]) < KEPT * known.sum()


def refuse(told: World, world: World) -> World:
    """Take back what a world believes beyond what was told: with it, too few pixels can be explained."""
    why = "as told: with what the events seem to tell fewer pixels can be explained"
    new = {name: d for name, d in world.decisions.items() if told.decisions.get(name) is not d}
    taken = {name: replace(d, modelled=False, why=why) for name, d in new.items() if d.modelled}
    return replace(told, decisions=world.decisions | taken)


def moves_far(found: SharedFound | None, world: World) -> bool:
    """Say whether what pixels share moves their maps by enough for another fit."""
    if found is None:
        return False
    scale = np.abs(found.moved[2:]).max(initial=0)
    return found.inferred.moved_deg >= FAR * world.terms.limit_deg or scale > RESCALED


def moved_with(found: SharedFound | None, fitted: Fitted) -> Fitted:
    """Let all pixels' reflectances and thresholds move as those by which what they share was inferred."""
    return replace(fitted, solution=fitted.solution.moved(found.moved)) if found else fitted
