"""Background activity: events that come by chance, many where it is dark."""

from dataclasses import replace

from evsdr.effects.effect import Decision
from evsdr.effects.world import Fitted, World
from evsdr.solve.background import activity_of

FEW = 0.02  # of the events that may come by chance before any is left out; guessed
# As `Activity`; from there on, or from halfway to the number of rounds, it is no chance; guessed.
CLUMPED = 2.0


class BackgroundActivity:
    """Events that no light explains, spread over all slots, are left out."""

    name, option, when = "background activity", "", "anew"

    def decide(self, asked: str, world: World, fitted: Fitted) -> Decision | None:
        """Count the events toward which the light of a first fit has not gone."""
        if world.terms.solver != "lm" or world.metal is not None:
            return None
        activity = activity_of(fitted.problem, fitted.solution)
        share, rounds = activity.share, max(len(world.recording.round_start_us) - 1, 1)
        if share < FEW:
            return Decision(self.name, False, f"none: {share:.1%} of a pixel's events come by chance")
        if activity.clumped > min(CLUMPED, 0.5 * (1 + rounds)):
            return Decision(
                self.name, False, "none: what the light does not explain comes again in the same slots"
            )
        why = f"left out: {share:.0%} of a pixel's events come by chance"
        return Decision(self.name, True, why, found={"share": share}, answer=(activity, fitted))

    def model(self, world: World, decision: Decision) -> World:
        """Leave them out."""
        return replace(world, background=decision.answer)
