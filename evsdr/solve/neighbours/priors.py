"""What pixels tell of each other, as records of one kind.

A prior wants differences z = D q(theta) between pixels to be small, where q are quantities of each pixel and D takes
finite differences. It counts as  w z^T P z / 2  with a precision P that is learnt and the weight w of Student's t, so
that edges stay. Its matrix is J^T D^T w P D J, with J the derivatives of q.
"""

import math
from dataclasses import dataclass

import drjit as dr
import numpy as np

from evsdr.solve import triangles
from evsdr.solve.grid import AROUND_P, AROUND_Q, SECOND_X, SECOND_Y, SQUARE_MEAN, Links, Stencil

# Measured on bumpy meshes with square texels of reflectance 0.02 to 0.8: normals are 6 to 12 % better with 2 than with 1, and
# 2 to 4 % better still with 3, where single pixels of other scenes stay behind
LETTING_GO = 2
LEAST_LEFT = 0.4  # of what an edge keeps beside Student's t: measured: with 0.1 a few pixels that nothing else holds are lost


@dataclass(frozen=True)
class Prior:
    """Differences that are small.

    Attributes
    ----------
    name : str
    first, last : int
        The unknowns that it looks at, first .. last - 1.
    directions : tuple of tuple of dict of int to Stencil
        Of each direction the components of z; of each component, the stencil on each quantity.
    of_normal : bool
        Whether the quantities are n_x and n_y; else they are the unknowns themselves.
    flattened : bool
        Whether z is multiplied by n_z^2: slopes grow without bounds where normals don't.
    letting_go : int
        Power of the weight of z that are larger than most. With 1 it is that of Student's t, which pulls by (d + freedom) / z
        however far apart two neighbours are; with more, edges pull less and less.
    """

    name: str
    first: int
    last: int
    directions: tuple
    of_normal: bool = False
    flattened: bool = False
    letting_go: int = 1

    @property
    def size(self) -> int:
        """Number of components of z."""
        return len(self.directions[0])

    def valid(self, links: Links) -> list:
        """Tell for each direction where z exists."""
        return [next(iter(direction[0].values())).valid(links) for direction in self.directions]

    def quantities(self, theta: list) -> list:
        """Give q, evaluated."""
        q = list(theta[self.first : self.last])
        if self.of_normal:
            inv = dr.rsqrt(1.0 + dr.square(q[0]) + dr.square(q[1]))
            q = [-q[0] * inv, -q[1] * inv]
            dr.eval(q)
        return q

    def jacobian(self, theta: list) -> list | None:
        """Give the derivatives of q by the unknowns, symmetric: xx, xy, yy; None for the identity."""
        if not self.of_normal:
            return None
        p, q = theta[:2]
        inv = dr.rsqrt(1.0 + p * p + q * q)
        cube = inv * inv * inv
        return [p * p * cube - inv, p * q * cube, q * q * cube - inv]

    def factor(self, theta: list, links: Links):
        """Give what z is multiplied by."""
        if not self.flattened:
            return 1.0
        square = dr.rcp(1.0 + dr.square(theta[0]) + dr.square(theta[1]))
        dr.eval(square)
        return SQUARE_MEAN.apply(links, square)

    def values(self, q: list, links: Links) -> list[list]:
        """Give z of quantities q, which are evaluated, without the factor: for each direction its components."""
        return [
            [sum(s.apply(links, q[k]) for k, s in component.items()) for component in direction]
            for direction in self.directions
        ]

    def adjoint(self, z: list[list], links: Links) -> list:
        """Apply D^T to evaluated z."""
        out = [0.0] * (self.last - self.first)
        for direction, components in zip(self.directions, z):
            for component, value in zip(direction, components):
                for k, stencil in component.items():
                    out[k] = out[k] + stencil.adjoint(links, value)
        return out

    def covariance(self, theta: list, inverse: list) -> list[list]:
        """Give the covariance of q from the lower triangle of that of the unknowns."""
        rows = triangles.rows(inverse, range(self.first, self.last))
        jacobian = self.jacobian(theta)
        return rows if jacobian is None else sandwich(jacobian, rows)

    def products(self) -> list[list[tuple]]:
        """Give for each direction what z_i z_j holds of q_k q_l: tuples (i, j, k, l, product of stencils)."""
        return [
            [
                (i, j, k, m, s.times(t))
                for i, first in enumerate(direction)
                for j, second in enumerate(direction)
                for k, s in first.items()
                for m, t in second.items()
            ]
            for direction in self.directions
        ]


def smooth_normals() -> Prior:
    """Let second differences of n_x and n_y be small."""
    return Prior("normal", 0, 2, _second_differences(2), of_normal=True)


def integrable() -> Prior:
    """Let slopes be those of a surface: their sum around four pixels is 0."""
    return Prior("integrable", 0, 2, (({0: AROUND_P, 1: AROUND_Q},),), flattened=True)


def smooth_reflectance(n_band: int) -> Prior:
    """Let second differences of log reflectances be small; with a full P a texture of one colour counts once.

    Edges of many bands would pull hardest, and dark pixels, which know their own contrast badly, toward bright neighbours.
    """
    return Prior("reflectance", 2, 2 + n_band, _second_differences(n_band), letting_go=LETTING_GO)


def _second_differences(n: int) -> tuple:
    return tuple(tuple({k: stencil} for k in range(n)) for stencil in (SECOND_X, SECOND_Y))


def sandwich(jacobian: list, inner: list[list]) -> list[list]:
    """J M J for symmetric J (xx, xy, yy)."""
    j = [[jacobian[0], jacobian[1]], [jacobian[1], jacobian[2]]]
    half = [[sum(j[i][k] * inner[k][m] for k in range(2)) for m in range(2)] for i in range(2)]
    return [[sum(half[i][k] * j[k][m] for k in range(2)) for m in range(2)] for i in range(2)]


# ---------------------------------------------------------------------- what has been learnt


@dataclass(frozen=True)
class Learnt:
    """A prior and how strong it is, as arrays of width 1.

    Attributes
    ----------
    prior : Prior
    precision : list of list of Float, (d, d)
        P.
    root : list of list of Float, (d, d)
        Its Cholesky factor.
    """

    prior: Prior
    precision: list
    root: list

    @classmethod
    def of(cls, prior: Prior, spread: np.ndarray, Float: type) -> "Learnt":
        """Lay the covariance (d, d) of z out."""
        precision = np.linalg.inv(spread)
        root = np.linalg.cholesky(0.5 * (precision + precision.T))
        return cls(prior, opaque_matrix(Float, precision), opaque_matrix(Float, root))


def opaque_matrix(Float: type, matrix: np.ndarray) -> list[list]:
    """Give the entries of a small matrix as arrays of width 1, which no kernel holds as numbers."""
    return [[dr.opaque(Float, float(value)) for value in row] for row in matrix]


def quadratic(matrix: list[list], z: list):
    """Give z^T M z."""
    return sum(m * z[i] * z[j] for i, row in enumerate(matrix) for j, m in enumerate(row))


def multiply(matrix: list[list], z: list) -> list:
    """Give M z."""
    return [sum(m * value for m, value in zip(row, z)) for row in matrix]


def edge_weights(learnt: Learnt, theta: list, inverse: list, links: Links, freedom) -> list:
    """Give the weight of each direction, times the squared factor; 0 where there is no difference. It is that of Student's t.

    By expectation maximisation: the square of z counts with its variance. `freedom` is that of Student's t: the smaller,
    the less an outlier counts.
    """
    prior = learnt.prior
    covariance, factor = prior.covariance(theta, inverse), prior.factor(theta, links)
    out = []
    values = prior.values(prior.quantities(theta), links)
    for products, z, valid in zip(prior.products(), values, prior.valid(links)):
        summed = {}
        for i, j, k, m, stencil in products:
            key = tuple(stencil.weight.items())
            summed[key] = summed.get(key, 0.0) + learnt.precision[i][j] * covariance[k][m]
        dr.eval(summed)
        around = sum(Stencil(dict(key)).apply(links, value) for key, value in summed.items())
        distance = dr.square(factor) * (quadratic(learnt.precision, z) + around)
        weight = (freedom + prior.size) / (
            freedom + dr.maximum(distance, 0.0)
        )  # rounding can make it negative
        weight *= dr.square(factor) * math.prod([dr.clip(weight, LEAST_LEFT, 1.0)] * (prior.letting_go - 1))
        out.append(dr.select(valid, weight, 0.0))
    dr.eval(out)
    return out


# ---------------------------------------------------------------------- the quadratic form


@dataclass(frozen=True)
class Form:
    """A learnt prior around some unknowns: a quadratic form.

    Attributes
    ----------
    learnt : Learnt
    weights : list of Float, (n_pixel) for each direction
        See `edge_weights`.
    jacobian : list of Float, optional
        See `Prior.jacobian`.
    """

    learnt: Learnt
    weights: list
    jacobian: list | None

    def product(self, v: list, links: Links) -> list:
        """Apply the matrix to a change v of the prior's unknowns, evaluated."""
        return self.carry(self._turn(v), links)

    def carry(self, q: list, links: Links) -> list:
        """Apply J^T D^T w P D to quantities."""
        dr.eval(q)
        z = self.learnt.prior.values(q, links)
        ends = [
            [w * value for value in multiply(self.learnt.precision, components)]
            for w, components in zip(self.weights, z)
        ]
        return self._back(ends, links)

    def draw(self, white: list[list], links: Links) -> list:
        """Make noise whose covariance is the matrix from white noise, for each direction and component."""
        ends = [
            [dr.sqrt(w) * value for value in multiply(self.learnt.root, noise)]
            for w, noise in zip(self.weights, white)
        ]
        return self._back(ends, links)

    def block(self, links: Links) -> list[list]:
        """Give the diagonal blocks of the matrix."""
        prior = self.learnt.prior
        n = prior.last - prior.first
        inner = [[0.0] * n for _ in range(n)]
        for products, weight in zip(prior.products(), self.weights):
            around = {}
            for i, j, k, m, stencil in products:
                key = tuple(stencil.weight.items())
                if key not in around:
                    around[key] = stencil.adjoint(links, weight)
                inner[k][m] = inner[k][m] + self.learnt.precision[i][j] * around[key]
        return inner if self.jacobian is None else sandwich(self.jacobian, inner)

    def _turn(self, v: list) -> list:
        if self.jacobian is None:
            return list(v)
        xx, xy, yy = self.jacobian
        return [xx * v[0] + xy * v[1], xy * v[0] + yy * v[1]]

    def _back(self, ends: list[list], links: Links) -> list:
        dr.eval(ends)
        return self._turn(self.learnt.prior.adjoint(ends, links))
