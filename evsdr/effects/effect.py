"""The protocol of effects: what else but the maps may shape the events, and how a fit decides on it."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from evsdr.effects.world import Fitted, World


@dataclass(frozen=True)
class Decision:
    """What was decided on an effect, and why.

    Attributes
    ----------
    effect : str
        Its name.
    modelled : bool
    why : str
        For the summary's `model`.
    expected_deg : float, optional
        Mean error of the normals if the effect is left out [deg], where that was asked.
    found : dict
        Numbers and words, for the summary's `effects`.
    answer : object, optional
        What `Effect.model` needs beside.
    warning : str
        What the user should look into if it is modelled.
    doubt : str
        What they should look into though it is not.
    taken_back : bool
        Whether it was modelled and is no more: a fit goes back to what it believed before.
    """

    effect: str
    modelled: bool
    why: str
    expected_deg: float | None = None
    found: dict = field(default_factory=dict)
    answer: object = None
    warning: str = ""
    doubt: str = ""
    taken_back: bool = False


class Effect(Protocol):
    """One thing that may shape the events beside the maps.

    Attributes
    ----------
    name : str
        Key in the summary. Effects of one name speak of one thing at different times; the last word counts.
    option : str
        The setting by which users ask for it; "" where there is none.
    when : str
        On what it is decided: `first`, before anything; `scene`, before any fit; `anew`, on a first fit that is then made anew; `alone`, on
        residuals of single pixels; `together`, on fitted maps, before the light settles on them; `settled`, on the
        residuals that then remain, twice, the second time to refine what was decided; `last`, on the maps as they are.
    """

    name: str
    option: str
    when: str

    def decide(self, asked: str, world: "World", fitted: "Fitted | None") -> Decision | None:
        """Decide on what is asked, `auto` by default; None adds nothing to what was decided before."""

    def model(self, world: "World", decision: Decision) -> "World":
        """Give the world with the effect in it."""
