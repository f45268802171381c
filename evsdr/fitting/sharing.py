"""What all pixels share is inferred, and their maps move with it: from first maps and sketches, and anew under another light."""

from dataclasses import replace

import numpy as np

from evsdr.effects.blocks import sample_of
from evsdr.effects.shared import SharedFound, find_shared, last_found
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


def settle_events(
    world: World, fitted: Fitted, settings: Settings, solve: Decoder, progress: Progress
) -> tuple[World, Fitted]:
    """Infer what pixels share, from rough maps and from sketches under what those before tell.

    Where pixels are many they are some. Maps of pixels by which that is inferred move with it, and the others' alike. All are
    sketched under it where the maps shall tell what shape casts shadows.
    """
    told, teacher, sketch = world, sample_of(fitted), None
    for _ in range(MOST_SKETCHES):
        new, changed = deciding.decide("alone", told, teacher, settings, progress)
        found = find_shared(told, teacher)
        if not changed or sketch and not moves_far(found, world):
            world = world if sketch else new
            break
        before = moved_with(found, teacher)
        after = sketch_under(new, before, solve, progress)
        if loses(before, after):
            world = world if sketch else refuse(told, new)
            break
        world, told, fitted, sketch = new, replace(told, found=found), moved_with(found, fitted), after
        teacher = replace(sketch, problem=before.problem)
    if sketch and sketch.problem.n_pixel == fitted.problem.n_pixel:
        return world, sketch
    if sketch and world.ring.shape_is_known:
        return world, fitted
    return world, solve(world.problem(fitted), fitted, "sketch", progress)


def settle_events_at_once(
    world: World, fitted: Fitted, settings: Settings, solve: Decoder, progress: Progress
) -> tuple[World, Fitted]:
    """Infer what pixels share from rough maps, and let those move with it; sketches of a few pixels show whether that explains them.

    Where LEDs are not as told maps were bent by that, and the sketches are asked once more. Measured in fast fits of `experiments.draws` whose powers
    were 10 % off: 16, 24, 6, 4 18.3 7.9 6.7 14.9 -> 9.9 3.4 4.9 11.6 degrees, 21 6.2 -> 7.3, of 14 more none by more than scatter.
    """
    new, changed = deciding.decide("alone", world, fitted, settings, progress)
    if not changed:
        return new, fitted
    moved = moved_with(find_shared(world, fitted), fitted)
    some = sample_of(moved, FEW)
    sketch = sketch_under(new, some, solve, progress)
    if loses(some, sketch):
        return refuse(world, new), fitted
    moved = replace(moved, solution=replace(moved.solution, noise=sketch.solution.noise))
    if new.aim is world.aim:
        return new, moved
    told, teacher = replace(world, found=find_shared(world, fitted)), replace(sketch, problem=some.problem)
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


def sketch_under(world: World, fitted: Fitted, solve: Decoder, progress: Progress) -> Fitted:
    """Sketch the pixels of a fit under what is believed."""
    world = replace(world, mask=fitted.problem.grid.mask)
    return solve(world.problem(fitted), fitted, "sketch", progress)


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
