"""The linear system of all pixels that a Gauss-Newton step with priors solves, and draws from its inverse."""

from collections.abc import Callable

import drjit as dr
import numpy as np

from evsdr.solve import triangles
from evsdr.solve.grid import AROUND_P, AROUND_Q, Grid
from evsdr.solve.neighbours.stencils import (
    DIRECTIONS,
    normal_jacobian,
    normal_xy,
    quadratic,
    sandwich,
    steepness,
    traced,
)
from evsdr.solve.neighbours.student import FREEDOM

TOLERANCE, MOST_STEPS, LOOK = 0.01, 100, 5  # of the conjugate gradients; steps between two looks


def with_spectra(theta, data, inverse, spectra, n_band) -> tuple[list, list]:
    """Add the prior on spectra to gradient and matrix."""
    gradient, matrix = list(data[1]), list(data[2])
    if spectra is None:
        return gradient, matrix
    r = [dr.exp(t) for t in theta[2 : 2 + n_band]]
    off = [value - float(mean) for value, mean in zip(r, spectra.mean)]
    noise = triangles.rows(inverse, range(2, 2 + n_band))
    noise = [[noise[i][j] * r[i] * r[j] for j in range(n_band)] for i in range(n_band)]
    distance = quadratic(spectra.precision, off) + traced(spectra.precision, noise)
    weight = (FREEDOM + n_band) / (FREEDOM + distance)
    for i in range(n_band):
        row = [float(v) for v in spectra.precision[i]]
        gradient[2 + i] = gradient[2 + i] + weight * r[i] * sum(v * o for v, o in zip(row, off))
        for j in range(i + 1):
            at = triangles.place(2 + i, 2 + j)
            matrix[at] = matrix[at] + weight * row[j] * r[i] * r[j]
    dr.eval(gradient, matrix)
    return gradient, matrix


def joint_system(theta, matrix, damping, weights, scatter, grid, n_band) -> dict:
    """Collect what the product with the matrix of all pixels needs, and its preconditioner."""
    Float = type(theta[0])
    n = len(theta)
    matrix = list(matrix)
    for i in range(n):
        matrix[triangles.place(i, i)] = matrix[triangles.place(i, i)] * (1.0 + damping)
    system = {"matrix": matrix}
    block = list(matrix)
    if "normal" in weights:
        precision = np.linalg.inv(scatter["normal"])
        jacobian = normal_jacobian(theta)
        around = _around(weights["normal"], grid)
        inner = [[around * float(v) for v in row] for row in precision]
        turned = sandwich(jacobian, inner)
        for i, j in ((0, 0), (1, 0), (1, 1)):
            block[triangles.place(i, j)] = block[triangles.place(i, j)] + turned[i][j]
        system["jacobian"] = jacobian
        system["normal_precision"] = [[dr.opaque(Float, float(v)) for v in row] for row in precision]
        system["normal"] = weights["normal"]
    if "integrable" in weights:
        square = (
            weights["integrable"][0] * dr.square(steepness(theta, grid)) / float(scatter["integrable"][0, 0])
        )
        dr.eval(square)
        for i, stencil in enumerate((AROUND_P, AROUND_Q)):
            block[triangles.place(i, i)] = block[triangles.place(i, i)] + stencil.squared().adjoint(
                grid, square
            )
        system["square"] = square
    if "reflectance" in weights:
        precision = np.linalg.inv(scatter["reflectance"])
        around = _around(weights["reflectance"], grid)
        for i in range(n_band):
            for j in range(i + 1):
                at = triangles.place(2 + i, 2 + j)
                block[at] = block[at] + around * float(precision[i, j])
        system["precision"] = [[dr.opaque(Float, float(v)) for v in row] for row in precision]
        system["reflectance"] = weights["reflectance"]
    lower, pivot = triangles.factor(block)
    system["lower"], system["pivot"] = lower, pivot
    system["inverse"] = triangles.invert(lower, pivot)
    dr.eval(system)
    return system


def _around(weights: list, grid: Grid):
    """Sum over the differences that a pixel takes part in: squared factor times weight."""
    return sum(s.squared().adjoint(grid, w) for s, w in zip(DIRECTIONS, weights))


def _prior_product(v: list, normal: list, system: dict, grid: Grid, n_band: int) -> list:
    """Apply the matrix of the smooth and integrable priors to slopes and log reflectances v.

    `normal` holds what v means for n_x and n_y. All are evaluated arrays.
    """
    ends = {}
    if "normal" in system:
        ends["normal"] = [
            [w * s.apply(grid, u) for u in normal] for s, w in zip(DIRECTIONS, system["normal"])
        ]
    if "square" in system:
        ends["square"] = system["square"] * (AROUND_P.apply(grid, v[0]) + AROUND_Q.apply(grid, v[1]))
    if "reflectance" in system:
        ends["reflectance"] = [
            [w * s.apply(grid, u) for u in v[2 : 2 + n_band]]
            for s, w in zip(DIRECTIONS, system["reflectance"])
        ]
    dr.eval(ends)
    return _prior_adjoint(ends, system, grid, n_band, len(v))


def _prior_adjoint(ends: dict, system: dict, grid: Grid, n_band: int, n: int) -> list:
    """Carry differences back to the unknowns."""
    out = [0.0] * n
    if "normal" in ends:
        back = [sum(s.adjoint(grid, e[i]) for s, e in zip(DIRECTIONS, ends["normal"])) for i in range(2)]
        back = [sum(v * b for v, b in zip(row, back)) for row in system["normal_precision"]]
        xx, xy, yy = system["jacobian"]
        out[0] += xx * back[0] + xy * back[1]
        out[1] += xy * back[0] + yy * back[1]
    if "square" in ends:
        out[0] += AROUND_P.adjoint(grid, ends["square"])
        out[1] += AROUND_Q.adjoint(grid, ends["square"])
    if "reflectance" in ends:
        back = [
            sum(s.adjoint(grid, e[i]) for s, e in zip(DIRECTIONS, ends["reflectance"])) for i in range(n_band)
        ]
        for i, row in enumerate(system["precision"]):
            out[2 + i] += sum(v * b for v, b in zip(row, back))
    return out


def prior_gradient(theta, system, grid, n_band) -> list:
    return _prior_product(theta, normal_xy(theta), system, grid, n_band)


def perturbation(rng, system, scatter, grid, n_band) -> list:
    """Draw a right-hand side whose solution is a draw from the posterior."""
    Float = type(system["pivot"][0])
    n, n_pixel = len(system["pivot"]), dr.width(system["pivot"][0])

    def white(count):
        return [Float(row) for row in rng.standard_normal((count, n_pixel), np.float32)]

    right = triangles.color(*triangles.factor(system["matrix"]), white(n))
    ends = {}
    for part, d in (("normal", 2), ("reflectance", n_band)):
        if part in system:
            root = np.linalg.cholesky(scatter[part])  # precision times this is a root of the precision
            ends[part] = []
            for w in system[part]:
                noise = white(d)
                ends[part].append(
                    [dr.sqrt(w) * sum(float(v) * e for v, e in zip(row, noise)) for row in root]
                )
    if "square" in system:
        ends["square"] = dr.sqrt(system["square"]) * white(1)[0]
    dr.eval(ends)
    return [r + k for r, k in zip(right, _prior_adjoint(ends, system, grid, n_band, n))]


def joint_solver(grid: Grid) -> Callable:
    """Make a solver of systems of all pixels."""

    @dr.freeze
    def begin(system, right):
        z = triangles.solve(system["lower"], system["pivot"], right)
        return z, dr.sum(sum(r * s for r, s in zip(right, z)))

    @dr.freeze(state_fn=lambda *_: (grid.index, grid.exists))
    def step(system, x, r, p, rho):
        n_band = len(system["precision"]) if "precision" in system else 0
        normal = []
        if "jacobian" in system:
            xx, xy, yy = system["jacobian"]
            normal = [xx * p[0] + xy * p[1], xy * p[0] + yy * p[1]]
            dr.eval(normal)
        prior = _prior_product(p, normal, system, grid, n_band)
        q = [a + b for a, b in zip(triangles.multiply(system["matrix"], p), prior)]
        curvature = dr.sum(sum(a * b for a, b in zip(p, q)))
        dr.eval(q, curvature)
        alpha = rho / dr.maximum(curvature, 1e-30)
        x = [a + alpha * b for a, b in zip(x, p)]
        r = [a - alpha * b for a, b in zip(r, q)]
        z = triangles.solve(system["lower"], system["pivot"], r)
        new_rho = dr.sum(sum(a * b for a, b in zip(r, z)))
        dr.eval(x, r, z, new_rho)
        beta = new_rho / dr.maximum(rho, 1e-30)
        p = [a + beta * b for a, b in zip(z, p)]
        return x, r, p, new_rho

    def solve(system, right):
        system = {k: v for k, v in system.items() if k != "inverse"}
        r = list(right)
        dr.eval(r)
        p, rho = begin(system, r)
        first = float(rho[0])
        x = [dr.zeros(type(v), dr.width(v)) for v in r]
        dr.make_opaque(x)
        for i in range(MOST_STEPS):
            x, r, p, rho = step(system, x, r, p, rho)
            dr.eval(x, r, p, rho)
            if i % LOOK == LOOK - 1 and float(rho[0]) <= TOLERANCE**2 * first:
                break
        return x

    return solve
