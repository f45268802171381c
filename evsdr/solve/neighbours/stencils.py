"""The differences between pixels that priors want small, how noisy they are, and how much each counts."""

import drjit as dr
import numpy as np

from evsdr.solve import triangles
from evsdr.solve.grid import AROUND_P, AROUND_Q, SECOND_X, SECOND_Y, SQUARE_MEAN, Grid
from evsdr.solve.neighbours.student import FREEDOM

DIRECTIONS = (SECOND_X, SECOND_Y)


def normal_xy(theta: list) -> list:
    inv = dr.rsqrt(1.0 + dr.square(theta[0]) + dr.square(theta[1]))
    out = [-theta[0] * inv, -theta[1] * inv]
    dr.eval(out)
    return out


def normal_jacobian(theta: list) -> list:
    """Derivative of n_x, n_y by the slopes, symmetric: xx, xy, yy."""
    p, q = theta[:2]
    inv = dr.rsqrt(1.0 + p * p + q * q)
    cube = inv * inv * inv
    return [p * p * cube - inv, p * q * cube, q * q * cube - inv]


def steepness(theta: list, grid: Grid):
    """n_z^2, mean over a square of pixels: weighs slopes, which grow without bounds where normals don't."""
    square = dr.rcp(1.0 + dr.square(theta[0]) + dr.square(theta[1]))
    dr.eval(square)
    return SQUARE_MEAN.apply(grid, square)


def _parts_of(part: str, theta: list, grid: Grid, n_band: int) -> list[list]:
    """Give the differences that a prior wants small: one list of components for each direction."""
    if part == "normal":
        normal = normal_xy(theta)
        return [[s.apply(grid, n) for n in normal] for s in DIRECTIONS]
    if part == "reflectance":
        return [[s.apply(grid, t) for t in theta[2 : 2 + n_band]] for s in DIRECTIONS]
    around = AROUND_P.apply(grid, theta[0]) + AROUND_Q.apply(grid, theta[1])
    return [[around * steepness(theta, grid)]]


def _valid(part: str, grid: Grid) -> list:
    return [s.valid(grid) for s in ((SQUARE_MEAN,) if part == "integrable" else DIRECTIONS)]


def differences(part, theta, inverse, grid, n_band, sample) -> tuple[np.ndarray, np.ndarray]:
    """Give differences (n, d) at some pixels, and their covariances (n, d, d) if pixels are independent."""
    values, noises = [], []
    for components, valid in zip(_parts_of(part, theta, grid, n_band), _valid(part, grid)):
        some = sample[valid.numpy()[sample]]
        values.append(np.stack([c.numpy()[some] for c in components], axis=-1).astype(float))
        if part == "normal":
            a, b, c = (j.numpy()[some].astype(float) for j in normal_jacobian(theta))
            jacobian = np.stack([a, b, b, c], axis=-1).reshape(-1, 2, 2)
            noises.append(6 * jacobian @ triangles.block(inverse, range(2), some) @ jacobian)
        elif part == "reflectance":
            noises.append(6 * triangles.block(inverse, range(2, 2 + n_band), some))
        else:
            square = triangles.block(inverse, range(2), some)
            steep = steepness(theta, grid).numpy()[some].astype(float)
            noises.append((np.trace(square, axis1=1, axis2=2) * steep**2)[:, None, None])
    return np.concatenate(values), np.concatenate(noises)


def edge_weights(theta, inverse, scatter, grid, n_band) -> dict:
    """Give for each prior and direction the weight of Student's t; 0 where there is no difference."""
    out = {}
    for part, spread in scatter.items():
        precision = np.linalg.inv(spread)
        if part == "normal":
            variance = traced(precision, _turned(inverse, normal_jacobian(theta)))
        elif part == "reflectance":
            variance = traced(precision, triangles.rows(inverse, range(2, 2 + n_band)))
        else:
            square = inverse[0] + inverse[2]
            variance = float(precision[0, 0]) * square
        dr.eval(variance)
        d = len(spread)
        out[part] = []
        stencils = (SQUARE_MEAN,) if part == "integrable" else DIRECTIONS
        for components, stencil in zip(_parts_of(part, theta, grid, n_band), stencils):
            around = stencil.squared().apply(grid, variance)
            if part == "integrable":
                around = (
                    around * 4 * dr.square(steepness(theta, grid))
                )  # squares of the halves, not of the quarters
            distance = quadratic(precision, components) + around
            weight = (FREEDOM + d) / (FREEDOM + distance)
            out[part].append(dr.select(stencil.valid(grid), weight, 0.0))
    dr.eval(out)
    return out


def sandwich(jacobian: list, inner: list[list]) -> list[list]:
    """J M J for symmetric J (xx, xy, yy)."""
    j = [[jacobian[0], jacobian[1]], [jacobian[1], jacobian[2]]]
    half = [[sum(j[i][k] * inner[k][m] for k in range(2)) for m in range(2)] for i in range(2)]
    return [[sum(half[i][k] * j[k][m] for k in range(2)) for m in range(2)] for i in range(2)]


def _turned(inverse: list, jacobian: list) -> list[list]:
    return sandwich(jacobian, triangles.rows(inverse, range(2)))


def quadratic(precision: np.ndarray, z: list):
    return sum(float(precision[i, j]) * z[i] * z[j] for i in range(len(z)) for j in range(len(z)))


def traced(precision: np.ndarray, rows: list[list]):
    return sum(float(precision[i, j]) * rows[i][j] for i in range(len(rows)) for j in range(len(rows)))
