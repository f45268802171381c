"""Light and surface in turns: light is traced on what was fitted, and that is fitted under it."""

from dataclasses import replace

from evsdr.effects.indirect import IndirectLight
from evsdr.effects.sensitivity import mean_error
from evsdr.effects.world import ROUND_RAYS, Fitted, World
from evsdr.fitting.decoder import Decoder
from evsdr.progress import Progress

MOST_ROUNDS = 3  # of tracing and fitting
# Of the noise under direct light, from which indirect light is refused; measured: 0.97 to 1.03 where it is right, 1.06 where
# reflectances run away
WORSE = 1.04
SETTLED = 0.1  # of the first round's change, below which light has settled


def settle(
    world: World, light, fitted: Fitted, solve: Decoder, progress: Progress
) -> tuple[World, Fitted, dict]:
    """Trace light on what was fitted and fit again, until the light no longer changes; `light` is that before.

    Indirect light and reflectances can raise each other without end: where the events are then explained worse than by
    direct light, that is taken, unless the other was asked for.
    """
    direct = None
    if world.indirect and solve.settings.light_paths == "auto":
        alone = replace(world, indirect=False)
        light, problem = alone.illumination(fitted, ROUND_RAYS), alone.problem(fitted, ROUND_RAYS)
        direct = fitted = solve(problem, fitted, "quick", progress)
    first = 0.0
    for round_ in range(MOST_ROUNDS):
        new = world.illumination(fitted, ROUND_RAYS)
        change = mean_error(world.look(fitted), light, new)
        first = first if round_ else change
        if change < max(world.terms.limit_deg, SETTLED * first):
            break
        light = new
        fitted = solve(world.problem(fitted, ROUND_RAYS), fitted, "quick", progress)
        if progress("light and shape", (round_ + 1) / MOST_ROUNDS):
            break
    note = (
        f"{round_ + 1}: tracing anew would turn normals by {change:.2g} degrees in the last, "
        f"{first:.2g} in the first"
    )
    if direct and fitted.solution.noise > WORSE * direct.solution.noise:
        world, fitted = IndirectLight().refuse(world), direct
    return world, fitted, {"rounds of light and shape": note}
