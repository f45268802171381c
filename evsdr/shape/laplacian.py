"""Weighted least squares of differences between neighbouring pixels: a graph Laplacian, solved by multigrid."""

import numpy as np

MOST_STEPS = 60  # of conjugate gradients
DAMPING = 0.8  # of Jacobi steps
OVERCORRECTION = 1.8  # of the coarse levels: constant pieces are too stiff


def ends(image: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """View the first and the second pixel of all pairs of neighbours along an axis."""
    return (image[:-1], image[1:]) if axis == 0 else (image[:, :-1], image[:, 1:])


def solve(weight, difference, start: np.ndarray, drop: float) -> np.ndarray:
    """Minimise sum of weight (value_j - value_i - difference)^2 over all pairs of neighbours.

    Conjugate gradients with one multigrid cycle as preconditioner, until the residual has dropped by the
    factor `drop` in the norm of the preconditioner. Pixels without weight keep their start.

    Parameters
    ----------
    weight, difference : pair of arrays, (H - 1, W) and (H, W - 1)
        Along rows and columns.
    start : (H, W) float
    """
    levels = _hierarchy(*weight)
    value = start.copy()
    pull = np.zeros(start.shape)
    for axis in (0, 1):
        flow = weight[axis] * (difference[axis] - np.diff(value, axis=axis))
        first, second = ends(pull, axis)
        first -= flow
        second += flow
    direction, previous, first_norm = np.zeros(start.shape), 1.0, None
    for _ in range(MOST_STEPS):
        correction = _cycle(levels, pull)
        norm = np.vdot(pull, correction)
        first_norm = norm if first_norm is None else first_norm
        if norm <= max(drop**2 * first_norm, np.finfo(float).tiny):
            break
        direction = correction + (norm / previous) * direction
        previous = norm
        image = _laplacian(levels[0], direction)
        length = norm / np.vdot(direction, image)
        value += length * direction
        pull -= length * image
    return value


def _hierarchy(rows: np.ndarray, columns: np.ndarray) -> list[tuple[np.ndarray, ...]]:
    """Join 2 x 2 pixels to one again and again: weights of a level are sums of the finer ones.

    Braess 1995, "Towards Algebraic Multigrid for Elliptic Problems of Second Order": aggregation with
    overcorrection as a preconditioner.

    Returns
    -------
    list of (rows, columns, diagonal, smoother)
    """
    levels = []
    while True:
        height, width = len(columns), rows.shape[1]
        diagonal = np.zeros((height, width))
        for axis, weight in enumerate((rows, columns)):
            for pixel in ends(diagonal, axis):
                pixel += weight
        smoother = np.where(diagonal > 0, DAMPING / np.where(diagonal > 0, diagonal, 1), 0)
        levels.append((rows, columns, diagonal, smoother))
        if height * width == 1:
            return levels
        half = (height + 1) // 2, (width + 1) // 2
        rows = _add_pairs(rows, 1)[1 : 2 * half[0] - 1 : 2]
        columns = _add_pairs(columns, 0)[:, 1 : 2 * half[1] - 1 : 2]


def _add_pairs(image: np.ndarray, axis: int) -> np.ndarray:
    """Add neighbours 0 and 1, 2 and 3 and so on; the last stays alone where their number is odd."""
    return np.add.reduceat(image, np.arange(0, image.shape[axis], 2), axis=axis)


def _laplacian(level, value: np.ndarray) -> np.ndarray:
    """Apply the weighted graph Laplacian."""
    rows, columns, diagonal, _ = level
    image = diagonal * value
    image[:-1] -= rows * value[1:]
    image[1:] -= rows * value[:-1]
    image[:, :-1] -= columns * value[:, 1:]
    image[:, 1:] -= columns * value[:, :-1]
    return image


def _cycle(levels, pull: np.ndarray) -> np.ndarray:
    """One symmetric multigrid V cycle: two Jacobi steps, the coarse correction, two Jacobi steps."""
    smoother = levels[0][-1]
    value = smoother * pull
    if len(levels) == 1:
        return value
    value += smoother * (pull - _laplacian(levels[0], value))
    rest = pull - _laplacian(levels[0], value)
    coarse = _cycle(levels[1:], _add_pairs(_add_pairs(rest, 0), 1))
    fine = np.repeat(np.repeat(coarse, 2, axis=0), 2, axis=1)
    value += OVERCORRECTION * fine[: pull.shape[0], : pull.shape[1]]
    for _ in range(2):
        value += smoother * (pull - _laplacian(levels[0], value))
    return value
