"""The linear system of all pixels that a Gauss-Newton step with priors solves, and draws from its inverse."""

from dataclasses import dataclass

import drjit as dr
import numpy as np

from evsdr.frozen import recorded
from evsdr.model.arrays import owned
from evsdr.solve import triangles
from evsdr.solve.grid import Links
from evsdr.solve.neighbours.priors import Form, Learnt, edge_weights, multiply, quadratic
from evsdr.solve.neighbours.spectra import LearntSpectra
from evsdr.solve.neighbours.student import FREEDOM

SMALLEST_MULTIPLE = 1e-3  # of a spectrum that may be compared with the mean
MOST_STEPS, LOOK = 100, 3  # of the conjugate gradients; steps between two looks


@dataclass(frozen=True)
class JointSystem:
    """Data and priors around some unknowns: a quadratic form of all pixels.

    Attributes
    ----------
    matrix : list of Float, (n_pixel)
        Lower triangles of the pixels' own matrices.
    forms : list of Form
        What ties them to each other.
    lower, pivot
        Factors of the diagonal blocks, which precondition the system; see `triangles.factor`.
    """

    matrix: list
    forms: list
    lower: list
    pivot: list


@recorded
def weigh(learnt: list[Learnt], theta: list, inverse: list, links: Links, freedom) -> list[Form]:
    """Give the quadratic forms of priors around some unknowns.

    Parameters
    ----------
    inverse : list of Float
        Lower triangle of the covariance of each pixel's unknowns.
    freedom : Float
        Of Student's t: the smaller, the less an outlier counts.
    """
    return [
        Form(each, edge_weights(each, theta, inverse, links, freedom), each.prior.jacobian(theta))
        for each in learnt
    ]


@recorded
def make_system(forms: list[Form], matrix: list, damping, links: Links):
    """Damp the pixels' matrices and factor the diagonal blocks; gives damped matrices, factors, and inverse blocks."""
    n = int((8 * len(matrix) + 1) ** 0.5) // 2
    matrix = list(matrix)
    for i in range(n):
        matrix[triangles.place(i, i)] = matrix[triangles.place(i, i)] * (1.0 + damping)
    whole = list(matrix)
    for form in forms:
        first, block = form.learnt.prior.first, form.block(links)
        for i, row in enumerate(block):
            for j in range(i + 1):
                at = triangles.place(first + i, first + j)
                whole[at] = whole[at] + row[j]
    lower, pivot = triangles.factor(whole)
    return matrix, lower, pivot, triangles.invert(lower, pivot)


@recorded
def add_spectra(spectra: LearntSpectra, theta: list, gradient: list, matrix: list, inverse: list):
    """Add the prior on spectra to gradient and matrix.

    It speaks of colours, of the multiple of a spectrum that is nearest to the mean: how bright a pixel is in all, is free.
    """
    gradient, matrix, n_band = list(gradient), list(matrix), len(spectra.mean)
    r = [dr.exp(t) for t in theta[2 : 2 + n_band]]
    along = multiply(spectra.precision, r)
    length = sum(a * value for a, value in zip(along, r))
    nearest = dr.maximum(sum(a * mean for a, mean in zip(along, spectra.mean)) / length, SMALLEST_MULTIPLE)
    precision = [
        [dr.square(nearest) * (p - along[i] * along[j] / length) * r[i] * r[j] for j, p in enumerate(row)]
        for i, row in enumerate(spectra.precision)
    ]
    off = [-mean / (nearest * value) for value, mean in zip(r, spectra.mean)]
    noise = triangles.rows(inverse, range(2, 2 + n_band))
    spread = sum(p * noise[i][j] for i, row in enumerate(precision) for j, p in enumerate(row))
    weight = spectra.share * (FREEDOM + n_band) / (FREEDOM + quadratic(precision, off) + spread)
    for i, row in enumerate(precision):
        gradient[2 + i] = gradient[2 + i] + weight * sum(p * o for p, o in zip(row, off))
        for j in range(i + 1):
            at = triangles.place(2 + i, 2 + j)
            matrix[at] = matrix[at] + weight * row[j]
    return gradient, matrix


def _added(v: list, parts: list[tuple[int, list]]) -> list:
    """Add what priors give for their unknowns, each from the first one on."""
    out = list(v)
    for first, values in parts:
        for i, value in enumerate(values):
            out[first + i] = out[first + i] + value
    return out


@recorded
def right_side(forms: list[Form], theta: list, gradient: list, links: Links) -> list:
    """Give minus the gradient, with the pull of the priors."""
    pulls = [
        (form.learnt.prior.first, form.carry(form.learnt.prior.quantities(theta), links)) for form in forms
    ]
    return [-g for g in _added(gradient, pulls)]


def draw(rng: np.random.Generator, system: JointSystem, links: Links) -> list:
    """Draw a right-hand side whose solution is a draw from the posterior."""
    Float, n_pixel = type(system.pivot[0]), dr.width(system.pivot[0])

    def white(count):
        return [owned(Float, row) for row in rng.standard_normal((count, n_pixel), np.float32)]

    noise = [[white(form.learnt.prior.size) for _ in form.weights] for form in system.forms]
    return _coloured(system, white(len(system.pivot)), noise, links)


@recorded
def _coloured(system: JointSystem, white: list, noise: list, links: Links) -> list:
    right = triangles.color(*triangles.factor(system.matrix), white)
    # by rounding a matrix of badly known pixels can have no root: such a pixel draws what its neighbours make of it
    right = [dr.select(dr.isfinite(v), v, 0.0) for v in right]
    parts = [(form.learnt.prior.first, form.draw(own, links)) for form, own in zip(system.forms, noise)]
    return _added(right, parts)


# ---------------------------------------------------------------------- conjugate gradients


def _along(a: list, b: list):
    return sum(v * w for v, w in zip(a, b))


@recorded
def _begin(system: JointSystem, right: list):
    z = triangles.solve(system.lower, system.pivot, right)
    along = _along(right, z)
    dr.eval(z, along)
    return z, dr.sum(along)


@recorded
def _step(system: JointSystem, links: Links, x: list, r: list, p: list, rho):
    products = [
        (f.learnt.prior.first, f.product(p[f.learnt.prior.first : f.learnt.prior.last], links))
        for f in system.forms
    ]
    q = _added(triangles.multiply(system.matrix, p), products)
    along = _along(p, q)
    dr.eval(q, along)  # at once: a sum alone would evaluate what it is of for itself
    curvature = dr.sum(along)
    # by rounding a matrix of badly known pixels can be indefinite: then the step so far stands (Steihaug 1983)
    alpha = dr.select(curvature > 0, rho / curvature, 0.0)
    x = [a + alpha * b for a, b in zip(x, p)]
    r = [a - alpha * b for a, b in zip(r, q)]
    z = triangles.solve(system.lower, system.pivot, r)
    along = _along(r, z)
    dr.eval(x, r, z, along)
    new_rho = dr.sum(along)
    beta = new_rho / dr.maximum(rho, 1e-30)
    p = [a + beta * b for a, b in zip(z, p)]
    return x, r, p, new_rho


def solve(system: JointSystem, right: list, links: Links, tolerance: float) -> list:
    """Solve by conjugate gradients, preconditioned pixel by pixel, until the residual has fallen to a tolerance."""
    r = list(right)
    p, rho = _begin(system, r)
    first = float(rho[0])
    x = [dr.zeros(type(v), dr.width(v)) for v in r]
    dr.make_opaque(x)
    for i in range(MOST_STEPS):
        x, r, p, rho = _step(system, links, x, r, p, rho)
        if i % LOOK == LOOK - 1 and float(rho[0]) <= tolerance**2 * first:
            break
    return x
