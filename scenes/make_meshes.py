"""Write the meshes: a bumpy star-shaped blob (blob.ply) and a steep height field (relief.ply)."""

from pathlib import Path

import numpy as np
import trimesh
from evsdr.scenes.formats import HERE, Mesh, write_ply

RELIEF_HALF_WIDTH = 1.2  # a little more than the film's
RELIEF_CELLS = 128
RELIEF_GRID = 7  # bumps along either side


def blob() -> Mesh:
    """Make a star-shaped blob: a sphere with round bumps and dents, 20,480 triangles.

    Its radius in direction d is 1 + sum_i a_i exp(k_i (d . c_i - 1)), scaled so that it just fits a
    centred cube of half width 1. The vertex normals are analytic; uv is the projection along z.

    Returns
    -------
    Mesh
    """
    rng = np.random.default_rng(2)
    n_bump = 60
    center = rng.standard_normal((n_bump, 3))
    center /= np.linalg.norm(center, axis=1, keepdims=True)
    sharpness = rng.uniform(10, 45, n_bump)
    height = rng.choice([-1.0, 1.0], n_bump, p=[0.3, 0.7]) * rng.uniform(0.35, 0.8, n_bump) / sharpness**0.5

    sphere = trimesh.creation.icosphere(subdivisions=5)
    d = np.asarray(sphere.vertices) / np.linalg.norm(sphere.vertices, axis=1, keepdims=True)
    bump = height * np.exp(sharpness * (d @ center.T - 1))
    radius = 1 + bump.sum(axis=1, keepdims=True)
    gradient = (sharpness * bump) @ center
    gradient -= np.sum(gradient * d, axis=1, keepdims=True) * d

    normal = radius * d - gradient
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    position = radius * d
    lowest, highest = position.min(axis=0), position.max(axis=0)
    position = (position - 0.5 * (lowest + highest)) / (0.5 * np.max(highest - lowest))
    return Mesh(position, normal, 0.5 + 0.5 * position[:, :2], np.asarray(sphere.faces))


def relief() -> Mesh:
    """Make a height field of steep round bumps over the square |x|, |y| <= 1.2, 32,768 triangles.

    Returns
    -------
    Mesh
        With analytic vertex normals; uv is the projection along z.
    """
    rng = np.random.default_rng(7)
    cell = 2 * RELIEF_HALF_WIDTH / RELIEF_GRID
    grid = (np.arange(RELIEF_GRID) + 0.5) * cell - RELIEF_HALF_WIDTH
    center = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)
    center += rng.uniform(-0.3, 0.3, center.shape) * cell
    width = rng.uniform(0.16, 0.3, len(center)) * cell
    height = rng.uniform(1.8, 3.2, len(center)) * width

    side = np.linspace(-RELIEF_HALF_WIDTH, RELIEF_HALF_WIDTH, RELIEF_CELLS + 1)
    xy = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    offset = xy[:, None] - center
    bump = height * np.exp(-0.5 * np.sum(offset**2, axis=-1) / width**2)
    slope = np.einsum("ni,nij->nj", -bump / width**2, offset)
    normal = np.column_stack([-slope, np.ones(len(xy))])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)

    n = RELIEF_CELLS + 1
    corner = (np.arange(RELIEF_CELLS)[:, None] * n + np.arange(RELIEF_CELLS)).ravel()
    lower = np.stack([corner, corner + 1, corner + n + 1], axis=1)
    upper = np.stack([corner, corner + n + 1, corner + n], axis=1)
    position = np.column_stack([xy, bump.sum(axis=1)])
    return Mesh(position, normal, 0.5 + 0.5 * xy / RELIEF_HALF_WIDTH, np.concatenate([lower, upper]))


def write(folder: Path = HERE) -> None:
    """Write the meshes."""
    write_ply(folder / "blob.ply", blob())
    write_ply(folder / "relief.ply", relief())


if __name__ == "__main__":
    write()
