"""From fitted normals to depth, the mesh that shadow rays are traced on, and the mesh to look at."""

from dataclasses import replace

import numpy as np
from scipy import ndimage

from evsdr.files.daylight import reflectance_to_srgb
from evsdr.records import Maps
from evsdr.shape.depth import Depth, integrate_normals, write_depth
from evsdr.shape.laplacian import ends
from evsdr.shape.mesh import SurfaceMesh, make_mesh, write_mesh
from evsdr.shape.patches import vertex_depth

# Rows and columns of a vertex off its pixel's centre: a ray through it may slip through
OFF_CENTRE = 0.01, 0.02
RIM = (0, 3, 6, 7, 8, 5, 2, 1)  # of a pixel's nine vertices, row after row; anticlockwise


def depth_of(maps: Maps, mask: np.ndarray, camera, anchor: np.ndarray, bounded: bool = True) -> Depth:
    """Integrate the fitted normals over all pixels that were solved; unknown ones hang on their neighbours.

    Parameters
    ----------
    maps : Maps
    mask : (H, W) bool
        Pixels solved.
    camera : CameraGeometry
    anchor : (H, W) float
        Depth of the scene's object, which gives each piece its mean depth; 0 where it is not seen.
    bounded : bool
        Whether the mask holds the object alone. Else its depth is that of the known pixels: silent background lies anywhere.
    """
    seen = mask & (anchor > 0)
    if not seen.any():
        return integrate_normals(maps.normal, mask, camera, maps.normal_sigma_deg)
    nearest = ndimage.distance_transform_edt(~seen, return_distances=False, return_indices=True)
    given, telling = anchor[tuple(nearest)], None if bounded else maps.mask
    return integrate_normals(maps.normal, mask, camera, maps.normal_sigma_deg, given, telling=telling)


def traced_mesh(depth: Depth, to_world: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Make the mesh that stands for the surface when light is traced.

    Each pixel has its own vertices, at its corners, the middles of its sides and its centre, as facets of whole
    pixels would cut off the ridges that cast shadows. At jumps the surface ends on either side, with walls along the
    lines of sight between, so that no light leaks through.

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
        The same for one mask: walls of height 0 stand where nothing jumps.
    """
    position = _positions(depth)[depth.mask].reshape(-1, 3)
    index = np.full((*depth.mask.shape, 9), -1)
    index[depth.mask] = np.arange(len(position)).reshape(-1, 9)
    own = index[depth.mask]
    faces = [own[:, [4, i, j]] for i, j in zip(RIM, RIM[1:] + RIM[:1])]
    for axis, (last, first) in enumerate((((6, 7, 8), (0, 1, 2)), ((2, 5, 8), (0, 3, 6)))):
        joined = np.logical_and(*ends(depth.mask, axis))
        one, other = (pixel[joined] for pixel in ends(index, axis))
        for k in (0, 1):
            a, b, c, d = one[:, last[k]], one[:, last[k + 1]], other[:, first[k]], other[:, first[k + 1]]
            faces += [np.stack(corner, axis=1) for corner in ((a, b, c), (b, d, c))]
    return position @ to_world[:3, :3].T + to_world[:3, 3], np.concatenate(faces)


def _positions(depth: Depth) -> np.ndarray:
    """Give the vertices (H, W, 3, 3, 3) of each pixel in the camera frame."""
    camera, value = depth.camera, vertex_depth(depth, OFF_CENTRE)
    row, column = np.meshgrid((0, 0.5, 1), (0, 0.5, 1), indexing="ij")
    row[1, 1] += OFF_CENTRE[0]
    column[1, 1] += OFF_CENTRE[1]
    height, width = depth.mask.shape
    x = (np.arange(width)[:, None, None] + column - camera.center[0]) * camera.pixel_size[0]
    y = (camera.center[1] - np.arange(height)[:, None, None, None] - row) * camera.pixel_size[1]
    xy = np.stack(np.broadcast_arrays(x, y), axis=-1)
    return np.concatenate([value[..., None] * xy if camera.perspective else xy, -value[..., None]], axis=-1)


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
    known = replace(depth, mask=depth.mask & maps.mask)
    colour = reflectance_to_srgb(maps.reflectance, maps.band_wavelength_nm)
    return make_mesh(known, maps.normal, colour, to_world)
