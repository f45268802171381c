"""The neighbours of the solved pixels, and finite differences between them."""

from dataclasses import dataclass

import drjit as dr
import numpy as np
from scipy import ndimage

from evsdr.model.arrays import owned

PLACE = {  # (row, column); row 0 is the top
    "right": (0, 1),
    "left": (0, -1),
    "up": (-1, 0),
    "down": (1, 0),
    "down_right": (1, 1),
    "up_left": (-1, -1),
}
OPPOSITE = {"right": "left", "up": "down", "down_right": "up_left"}
OPPOSITE |= {b: a for a, b in OPPOSITE.items()}
NEXT = ("right", "left", "up", "down")


@dataclass(frozen=True)
class Links:
    """Numbers of the neighbours of each solved pixel, as a PyTree of arrays.

    Attributes
    ----------
    index : dict of str to UInt32, (n_pixel)
        The pixel at each of `PLACE`; the pixel itself where there is none.
    exists : dict of str to Bool, (n_pixel)
        Whether there is one.
    """

    index: dict
    exists: dict


@dataclass(frozen=True)
class Grid:
    """Where the solved pixels lie, and their neighbours.

    Attributes
    ----------
    mask : (height, width) bool
        They are numbered row after row.
    links : Links
    """

    mask: np.ndarray
    links: Links


def make_grid(mask: np.ndarray, UInt32: type) -> Grid:
    """Number the masked pixels and find their neighbours.

    Parameters
    ----------
    mask : (height, width) bool
        Pixels that take part.
    UInt32 : type
        Dr.Jit type of the numbers.
    """
    own, index, exists = np.arange(np.count_nonzero(mask)), {}, {}
    for name in PLACE:
        at = beside(mask, name)
        index[name] = owned(UInt32, np.where(at >= 0, at, own))
        exists[name] = owned(UInt32, at >= 0) > 0
    dr.eval(index, exists)
    return Grid(mask, Links(index, exists))


def beside(mask: np.ndarray, place: str, step: int = 1) -> np.ndarray:
    """Give the number (n_pixel) of the masked pixel at one of `PLACE`, so many steps away; -1 where there is none."""
    height, width = mask.shape
    padded = np.full((height + 2 * step, width + 2 * step), -1)
    padded[step:-step, step:-step][mask] = np.arange(np.count_nonzero(mask))
    row, column = (step * (1 + away) for away in PLACE[place])
    return padded[row : row + height, column : column + width][mask]


def nearest(good: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Give the number (n_pixel) of the nearest masked pixel that is good (n_pixel)."""
    number, image = np.zeros(mask.shape, np.uint32), np.zeros(mask.shape, bool)
    number[mask], image[mask] = np.arange(len(good)), good
    place = ndimage.distance_transform_edt(~image, return_distances=False, return_indices=True)
    return number[tuple(place)][mask]


def lonely_grid(n_pixel: int, UInt32: type) -> Grid:
    """Give pixels that have no neighbours."""
    itself, never = dr.arange(UInt32, n_pixel), dr.zeros(UInt32, n_pixel)
    dr.make_opaque(itself, never)
    links = Links(dict.fromkeys(PLACE, itself), dict.fromkeys(PLACE, never > 0))
    dr.eval(links.exists)
    return Grid(np.ones((1, n_pixel), bool), links)


@dataclass(frozen=True)
class Stencil:
    """A finite difference at every pixel whose neighbours all exist, and 0 elsewhere.

    Attributes
    ----------
    weight : dict of str to float
        What the neighbour at each of `PLACE` counts, and the pixel itself as `here`.
    """

    weight: dict

    def valid(self, links: Links):
        """Tell where all neighbours exist."""
        there = [links.exists[place] for place in self.weight if place != "here"]
        out = there[0]
        for also in there[1:]:
            out = out & also
        return out

    def apply(self, links: Links, value):
        """Take the difference of an evaluated array."""
        return dr.select(self.valid(links), self._sum(links, value, self.weight), 0.0)

    def adjoint(self, links: Links, value):
        """Apply the transposed matrix to an evaluated array, which must be 0 where `valid` is not."""
        back = {OPPOSITE.get(place, place): weight for place, weight in self.weight.items()}
        return self._sum(links, value, back)

    def times(self, other: "Stencil") -> "Stencil":
        """Multiply weight by weight; a stencil times itself takes variances to the variance of the difference."""
        return Stencil({place: weight * other.weight[place] for place, weight in self.weight.items()})

    @staticmethod
    def _sum(links: Links, value, weights: dict):
        Float = type(value)
        return sum(
            weight
            * (value if place == "here" else dr.gather(Float, value, links.index[place], links.exists[place]))
            for place, weight in weights.items()
        )


SECOND_X = Stencil({"left": 1.0, "here": -2.0, "right": 1.0})
SECOND_Y = Stencil({"up": 1.0, "here": -2.0, "down": 1.0})
# Clockwise around the square of a pixel and its right, lower right and lower neighbours, the height gained is 0:
# p = dz/dx along the top, -q = -dz/dy down on the right, -p along the bottom, q up on the left.
AROUND_P = Stencil({"here": 0.5, "right": 0.5, "down": -0.5, "down_right": -0.5})
AROUND_Q = Stencil({"here": 0.5, "right": -0.5, "down": 0.5, "down_right": -0.5})
SQUARE_MEAN = Stencil({"here": 0.25, "right": 0.25, "down": 0.25, "down_right": 0.25})
