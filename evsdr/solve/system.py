"""What the cost of single pixels depends on beside their unknowns."""

from dataclasses import dataclass, replace

import drjit as dr

from evsdr.model.arrays import picked
from evsdr.solve.loss import Loss
from evsdr.solve.pair_data import PairData, room_for
from evsdr.solve.solution import Data, State
from evsdr.solve.unknowns import Unknowns


@dataclass(frozen=True)
class PixelSystem:
    """What the cost of all pixels depends on beside the unknowns.

    Attributes
    ----------
    model, constant_light
        See `solution.Data`.
    pairs : PairData
        The pairs that count.
    noise : Float
        Standard deviation of the relative residual, of width 1 or n_pixel.
    softness : Float
        Of the horizon, of width 1 or n_pixel.
    spread : list of Float
        See `solution.State`.
    loss : Loss
    unknowns : Unknowns
    room : Float
        See `pair_data.room_for`.
    weak : Float
        How much the weak priors of a pixel count, of width 1.
    """

    model: object
    constant_light: object
    pairs: PairData
    noise: object
    softness: object
    spread: list
    loss: Loss
    unknowns: Unknowns
    room: object
    weak: object

    def at(self, index) -> "PixelSystem":
        """Look at some pixels, UInt32 (n)."""
        same = {name: picked(getattr(self, name), index) for name in ("model", "noise", "softness")}
        room = room_for(type(self.room), dr.width(index), self.model.illumination.n_led)
        return replace(self, pairs=self.pairs.at(index), room=room, **same)


def system_of(data: Data, state: State, loss: Loss, noise=None, weak: float = 1.0) -> PixelSystem:
    """Collect the system of a state; noise as told, or that of most pixels."""
    Float = type(data.constant_light)
    noise = dr.opaque(Float, state.noise) if noise is None else noise
    return PixelSystem(
        data.model,
        data.constant_light,
        state.pairs,
        noise,
        state.softness,
        state.spread,
        loss,
        data.unknowns(state.theta),
        data.room,
        dr.opaque(Float, weak),
    )
