"""From fitted normals to depth, the mesh that shadow rays are traced on, and the mesh to look at."""

from dataclasses import replace

import numpy as np
from scipy import ndimage

from evsdr.files.daylight import reflectance_to_srgb
from evsdr.records import Maps
from evsdr.shape.depth import Depth, integrate_normals, write_depth
from evsdr.shape.mesh import SurfaceMesh, make_mesh, write_mesh

MARGIN = 3  # pixels around the image: one that the mesh reaches, two more for cubic interpolation
PLACE = (
    0.01,
    0.02,
)  # rows and columns of vertices off pixel centres: a ray through a vertex may slip through


def depth_of(maps: Maps, mask: np.ndarray, camera, anchor: np.ndarray) -> Depth:
    """Integrate the fitted normals over all pixels that were solved; unknown ones hang on their neighbours.

    Parameters
    ----------
    maps : Maps
    mask : (H, W) bool
        Pixels solved.
    camera : CameraGeometry
    anchor : (H, W) float
        Depth of the scene's object, which gives each piece its mean depth; 0 where it is not seen.
    """
    seen = mask & (anchor > 0)
    if not seen.any():
        return integrate_normals(maps.normal, mask, camera, maps.normal_sigma_deg)
    nearest = ndimage.distance_transform_edt(~seen, return_distances=False, return_indices=True)
    return integrate_normals(maps.normal, mask, camera, maps.normal_sigma_deg, anchor[tuple(nearest)])


def traced_mesh(depth: Depth, to_world: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Make the mesh that stands for the surface when light is traced.

    It has two vertices per pixel and axis, as facets of whole pixels would cut off the ridges that cast shadows. It
    reaches one pixel beyond the mask so that the outermost pixels lie on it whole, and has walls along the lines of
    sight at depth discontinuities, so that no light leaks through.

    Parameters
    ----------
    depth : Depth
    to_world : (4, 4) float
        From the camera frame to the world.

    Returns
    -------
    position : (n_vertex, 3) float
        Vertices in the world.
    face : (n_face, 3) int
        Their number depends on the mask alone.
    """
    mask = np.pad(depth.mask, MARGIN)
    near = tuple(ndimage.distance_transform_edt(~mask, return_distances=False, return_indices=True))
    filled = np.where(mask, np.pad(depth.depth, MARGIN), -np.inf)
    for _ in range(MARGIN):  # as far as the farthest neighbour: a nearer one would cast a shadow
        filled = np.where(np.isfinite(filled), filled, ndimage.maximum_filter(filled, 3))
    filled = np.where(np.isfinite(filled), filled, 0)
    component = np.pad(depth.component, MARGIN)[near]
    grown = ndimage.binary_dilation(mask, np.ones((3, 3)))
    value = _refined(_refined(filled, 0, PLACE[0]), 1, PLACE[1])
    row, column = (1 + place + 0.5 * np.arange(n) for n, place in zip(value.shape, PLACE))
    whole = np.ix_(np.floor(row + 0.5).astype(int), np.floor(column + 0.5).astype(int))
    component, grown = component[whole], grown[whole]
    camera = depth.camera
    x = (column - MARGIN + 0.5 - camera.center[0]) * camera.pixel_size[0]
    y = (camera.center[1] - (row - MARGIN) - 0.5) * camera.pixel_size[1]
    xy = np.stack(np.meshgrid(x, y), axis=-1)
    if camera.perspective:
        xy = value[..., None] * xy
    position = np.concatenate([xy, -value[..., None]], axis=-1)
    index = np.full(value.shape, -1)
    index[grown] = np.arange(np.count_nonzero(grown))
    corner = [index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]]
    piece = [component[:-1, :-1], component[:-1, 1:], component[1:, :-1], component[1:, 1:]]
    kept = np.all([c >= 0 for c in corner], axis=0) & np.all([p == piece[0] for p in piece], axis=0)
    a, b, c, d = (index[kept] for index in corner)
    face = np.concatenate([np.stack([a, c, d], axis=1), np.stack([a, d, b], axis=1)])
    return position[grown] @ to_world[:3, :3].T + to_world[:3, 3], face


def _refined(value: np.ndarray, axis: int, place: float) -> np.ndarray:
    """Interpolate cubically at `place` and `place` + 1/2 after each inner sample of an axis."""
    v = np.moveaxis(value, axis, 0)
    out = np.empty((2 * (len(v) - 3), *v.shape[1:]))
    for i, t in enumerate((place, place + 0.5)):
        weight = (
            -t * (t - 1) * (t - 2) / 6,
            (t + 1) * (t - 1) * (t - 2) / 2,
            -(t + 1) * t * (t - 2) / 2,
            (t + 1) * t * (t - 1) / 6,
        )
        out[i::2] = sum(w * v[k : len(v) - 3 + k] for k, w in enumerate(weight))
    return np.moveaxis(out, 0, axis)


def surface_files(depth: Depth, maps: Maps, to_world: np.ndarray) -> dict:
    """Give what writes `depth.exr` and `mesh.ply`, for `results.write_results`."""
    known = depth.mask & maps.mask
    shown = replace(depth, mask=known, depth=np.where(known, depth.depth, 0))
    mesh = masked_mesh(depth, maps, to_world)
    return {
        "depth.exr": lambda path: write_depth(path, shown),
        "mesh.ply": lambda path: write_mesh(path, mesh),
    }


def masked_mesh(depth: Depth, maps: Maps, to_world: np.ndarray) -> SurfaceMesh:
    """Make the mesh to look at, in the world, from the pixels whose normals are known."""
    component, _ = ndimage.label(maps.mask)
    known = replace(depth, mask=depth.mask & maps.mask, component=component)
    colour = reflectance_to_srgb(maps.reflectance, maps.band_wavelength_nm)
    return make_mesh(known, maps.normal, colour, to_world)
