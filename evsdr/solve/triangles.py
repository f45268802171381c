"""Small symmetric systems, one per pixel, solved by L D L^T unrolled over Dr.Jit arrays.

A matrix is the list of its lower triangle, row after row, each entry an array over the pixels.
"""

import drjit as dr
import numpy as np

SMALLEST_PIVOT = 1e-6  # relative to the diagonal: what float32 can tell from nothing
TINY = 1e-20


def factor(matrix: list, damping=0.0) -> tuple[list, list]:
    """Factor M + damping diag M.

    Where a pivot is nothing but rounding, so is what is left of its column: that is taken for 0, else inverses are not finite.

    Returns
    -------
    lower : list of list of Float
        Row i of the unit lower triangle L, without its diagonal.
    pivot : list of Float, (n)
        Diagonal of D, positive.
    """
    n = int((8 * len(matrix) + 1) ** 0.5) // 2
    row = [matrix[i * (i + 1) // 2 : (i + 1) * (i + 2) // 2] for i in range(n)]
    lower = [[None] * i for i in range(n)]
    pivot, inverse = [], []
    for j in range(n):
        d = row[j][j] * (1.0 + damping)
        for k in range(j):
            d = d - dr.square(lower[j][k]) * pivot[k]
        smallest = SMALLEST_PIVOT * row[j][j] + TINY
        pivot.append(dr.maximum(d, smallest))
        inverse.append(dr.select(d > smallest, dr.rcp(pivot[j]), 0.0))
        for i in range(j + 1, n):
            entry = row[i][j]
            for k in range(j):
                entry = entry - lower[i][k] * lower[j][k] * pivot[k]
            lower[i][j] = entry * inverse[j]
    return lower, pivot


def solve(lower: list, pivot: list, right: list) -> list:
    """Solve L D L^T x = b."""
    n, x = len(right), list(right)
    for i in range(n):
        for k in range(i):
            x[i] = x[i] - lower[i][k] * x[k]
    x = [value / p for value, p in zip(x, pivot)]
    for i in reversed(range(n)):
        for k in range(i + 1, n):
            x[i] = x[i] - lower[k][i] * x[k]
    return x


def invert(lower: list, pivot: list) -> list:
    """Give the lower triangle of (L D L^T)^-1."""
    n = len(pivot)
    inverse = [[None] * i for i in range(n)]  # of L, without its unit diagonal
    for j in range(n):
        for i in range(j + 1, n):
            entry = -lower[i][j]
            for k in range(j + 1, i):
                entry = entry - lower[i][k] * inverse[k][j]
            inverse[i][j] = entry
    rcp = [dr.rcp(p) for p in pivot]

    def entry(k, i):
        return inverse[k][i] if k > i else 1.0

    return [
        sum(entry(k, i) * entry(k, j) * rcp[k] for k in range(i, n)) for i in range(n) for j in range(i + 1)
    ]


def multiply(matrix: list, x: list) -> list:
    """Give M x."""
    n = len(x)
    return [
        sum(matrix[max(i, j) * (max(i, j) + 1) // 2 + min(i, j)] * x[j] for j in range(n)) for i in range(n)
    ]


def color(lower: list, pivot: list, white: list) -> list:
    """Give L D^(1/2) w: noise of covariance M from white noise w."""
    scaled = [dr.sqrt(p) * w for p, w in zip(pivot, white)]
    return [scaled[i] + sum(lower[i][k] * scaled[k] for k in range(i)) for i in range(len(white))]


def added(a: list, b: list) -> list:
    """Give the sum of two matrices."""
    return [x + y for x, y in zip(a, b)]


def place(i: int, j: int) -> int:
    """Place of entry (i, j) in a lower triangle."""
    return max(i, j) * (max(i, j) + 1) // 2 + min(i, j)


def rows(triangle: list, which) -> list[list]:
    """Give the rows and columns `which` of a matrix."""
    return [[triangle[place(i, j)] for j in which] for i in which]


def block(triangle: list, which, some) -> np.ndarray:
    """Give a block of the matrices of some pixels (n, d, d)."""
    entries = [[v.numpy()[some] for v in row] for row in rows(triangle, which)]
    return np.moveaxis(np.array(entries, float), -1, 0)


def inverse_of(block: np.ndarray) -> np.ndarray:
    """Invert matrices (n, k, k) that hold single precision; those that rounding made singular as if a little stiffer.

    As where all of a pixel's events are of one LED and steep: what they say of one direction hides all else.
    """
    try:
        return np.linalg.inv(block)
    except np.linalg.LinAlgError:
        stiffer = SMALLEST_PIVOT * (np.linalg.slogdet(block).sign == 0)
        diagonal = block * np.eye(block.shape[-1])
        return np.linalg.inv(block + stiffer[:, None, None] * diagonal)
