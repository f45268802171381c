"""Pose of a CAD model in the camera view, from points and from the outline of a mask.

X_camera = R s (X - c) + t, with c the middle of the mesh and s its unit. Points give the start; then the
outline of the mask is matched, as in iterative closest points, with the mesh's contour: the edges between
faces that face the camera and faces that don't (Besl and McKay 1992; point-to-line distance of Chen and
Medioni 1992).
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import contourpy
import numpy as np
from scipy.ndimage import map_coordinates
from scipy.optimize import least_squares
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from evsdr.errors import InputError
from evsdr.files.numbers import read_numbers
from evsdr.model.view import View
from evsdr.progress import Progress, silent

FEWEST_POINTS = 4
POINT_SIGMA = 0.5  # of a point picked by hand [pixels]
OUTLINE_SIGMA = 0.5  # of a point of a mask's outline [pixels]
OFFSET_SIGMA = 1.0  # of how far the whole outline is drawn too far in or out [pixels]
NORMAL_SIGMA = 0.05  # of a fitted normal map, shading and smoothing included
MOST_OUTLINE = 800  # points of the outline, and as many normals
MOST_MATCHES = 60
SMALL_STEP = 1e-5  # of the unknowns, relative to the mesh, at which matching ends


@dataclass(frozen=True)
class CadModel:
    """A mesh with what its contour needs.

    Attributes
    ----------
    vertex, normal : (n_vertex, 3) float
        Vertices about the middle [scene units], and their unit normals.
    face_normal : (n_face, 3) float
    edge, side : (n_edge, 2) int
        Vertices of each edge, and the two faces beside it; the same face twice at a border.
    middle : (3,) float
        Middle of the mesh in its own coordinates.
    unit : float
        Scene units per unit of the mesh.
    size : float
        Half the diagonal of its box [scene units].
    """

    vertex: np.ndarray
    normal: np.ndarray
    face_normal: np.ndarray
    edge: np.ndarray
    side: np.ndarray
    middle: np.ndarray
    unit: float
    size: float


@dataclass(frozen=True)
class PoseEvidence:
    """What the pose must explain; all parts are optional.

    Attributes
    ----------
    point_pixel : (n, 2) float, point_model : (n, 3) float
        Columns and rows [pixels], and the points in the mesh's own coordinates.
    mask : (H, W) bool
        Silhouette.
    normal : (H, W, 3) float
        Fitted normal map, camera frame, zero where nothing is known.
    """

    point_pixel: np.ndarray = field(default_factory=lambda: np.empty((0, 2)))
    point_model: np.ndarray = field(default_factory=lambda: np.empty((0, 3)))
    mask: np.ndarray | None = None
    normal: np.ndarray | None = None


@dataclass(frozen=True)
class Pose:
    """A rigid pose, X_camera = rotation (unit X - middle) + translation.

    Attributes
    ----------
    rotation : (3, 3) float
    translation : (3,) float
        Of the mesh's middle, camera frame [scene units].
    rotation_sigma_deg : (3,) float
        About the axes of the camera frame [deg].
    translation_sigma : (3,) float
        0 for the depth of an orthographic camera, which can't be seen and is not estimated.
    point_residual : (n,) float
        Distances [pixels].
    outline, contour : (n_outline, 2) float
        Points of the mask's outline, and those of the mesh's contour matched to them [pixels].
    outline_residual : (n_outline,) float
        Distances across the outline, without its offset [pixels].
    outline_offset, outline_offset_sigma : float
        How far the mask is drawn inside of the true outline [pixels].
    """

    rotation: np.ndarray
    translation: np.ndarray
    rotation_sigma_deg: np.ndarray
    translation_sigma: np.ndarray
    point_residual: np.ndarray
    outline: np.ndarray
    contour: np.ndarray
    outline_residual: np.ndarray
    outline_offset: float
    outline_offset_sigma: float


def read_model(path: Path, unit: float):
    """Read a mesh of any format that trimesh reads.

    Returns
    -------
    mesh : trimesh.Trimesh
    model : CadModel

    Raises
    ------
    InputError
        The file holds no mesh.
    """
    import trimesh

    if not path.is_file():
        raise InputError(f"{path}: no such file; give the path of a mesh.")
    try:
        mesh = trimesh.load(path, force="mesh", process=True)
        if not len(mesh.faces):
            raise ValueError("it has no faces")
    except Exception as error:  # trimesh raises whatever its readers do
        raise InputError(
            f"{path}: not a mesh that trimesh reads ({error}); export it as PLY or OBJ."
        ) from error
    if not np.isfinite(mesh.vertices).all() or not 0 < unit < np.inf:
        raise InputError(f"{path}: its vertices and --unit must be finite, and --unit above 0; correct them.")
    border = trimesh.grouping.group_rows(mesh.edges_sorted, require_count=1)
    edge = np.concatenate([mesh.face_adjacency_edges, mesh.edges_sorted[border]])
    side = np.concatenate([mesh.face_adjacency, np.repeat(mesh.edges_face[border][:, None], 2, axis=1)])
    middle = mesh.bounds.mean(axis=0)
    return mesh, CadModel(
        vertex=unit * (mesh.vertices - middle),
        normal=np.array(mesh.vertex_normals),
        face_normal=np.array(mesh.face_normals),
        edge=edge,
        side=side,
        middle=middle,
        unit=unit,
        size=0.5 * unit * float(np.linalg.norm(mesh.extents)),
    )


def read_points(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Read a CSV x_pixel, y_pixel, X, Y, Z: where points of the mesh are seen.

    Raises
    ------
    InputError
        The file can't be used.
    """
    table = read_numbers(path, "not a readable CSV; write x_pixel,y_pixel,X,Y,Z in each line")
    if table.shape[1] == 5 and np.isnan(table[0]).all():  # a line of names
        table = table[1:]
    if table.shape[1] != 5 or not np.isfinite(table).all() or len(table) < FEWEST_POINTS:
        raise InputError(
            f"{path}: write {FEWEST_POINTS} lines or more of five numbers: x_pixel,y_pixel,X,Y,Z."
        )
    spread = np.linalg.svd(table[:, 2:] - table[:, 2:].mean(axis=0), compute_uv=False)
    if spread[1] < 1e-6 * max(spread[0], 1e-300):
        raise InputError(f"{path}: the points lie on one line, which tells no pose; add others.")
    return table[:, :2], table[:, 2:]


def find_pose(
    view: View, model: CadModel, evidence: PoseEvidence, depth: float, progress: Progress = silent
) -> Pose:
    """Find the pose that explains points, outline and normals.

    Parameters
    ----------
    view : View
    model : CadModel
    evidence : PoseEvidence
        Points, or a mask, or both.
    depth : float
        Distance of the mesh's middle from the camera: kept by an orthographic camera, a start for others.
    progress : callable (detail, share), optional
        Told how far it is.

    Raises
    ------
    InputError
        Nothing to go by, or the mesh can't be brought to the mask.
    """
    if not len(evidence.point_pixel) and evidence.mask is None:
        raise InputError("nothing tells the pose; give --points, --mask, or both.")
    if evidence.mask is not None and not evidence.mask.any():
        raise InputError("the mask is empty; draw the object's silhouette in it.")
    solver = _Solver(view, model, evidence, depth)
    x = solver.start()
    outline, across = (None, None) if evidence.mask is None else mask_outline(evidence.mask)
    matched = None
    for k in range(MOST_MATCHES if outline is not None else 1):
        progress("match the outline", k / MOST_MATCHES)
        if outline is not None:
            matched = solver.match(x, outline)
        residuals = solver.residuals(outline, across, matched)
        after = least_squares(residuals, x, loss="cauchy", f_scale=3.0, x_scale="jac", max_nfev=20).x
        small = np.abs(after - x).max() < SMALL_STEP * max(1.0, model.size)
        x = after
        if small:
            break
    return solver.pose(x, residuals, outline, across, matched)


def mask_outline(mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Give points of a mask's outer outline (n, 2) [pixels], and unit vectors across it, outward (n, 2).

    Where the mask meets the image border there is no outline.
    """
    lines = contourpy.contour_generator(z=np.pad(mask, 1).astype(float)).lines(0.5)
    line = max(lines, key=len) - 0.5
    smooth = np.stack(
        [np.convolve(np.concatenate([c[-5:], c[:-1], c[:5]]), np.ones(9) / 9, "same")[5:-4] for c in line.T]
    )
    tangent = np.gradient(smooth[:, :-1], axis=1).T
    line = line[:-1]
    length = np.linalg.norm(tangent, axis=1)
    height, width = mask.shape
    inner = (length > 0) & (np.abs(line - [width / 2, height / 2]) < [width / 2 - 0.9, height / 2 - 0.9]).all(
        axis=1
    )
    line, tangent = line[inner], tangent[inner] / length[inner, None]
    if len(line) < 20:
        raise InputError("the mask's outline lies on the border of the image; show the whole object.")
    step = -(-len(line) // MOST_OUTLINE)
    across = np.stack([tangent[:, 1], -tangent[:, 0]], axis=1)
    x, y = smooth[:, :-1]
    turn = np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))  # twice the area, with the sense of the line
    return line[::step], np.sign(turn) * across[::step]


class _Solver:
    """The unknowns: rotation vector about the camera's axes, shift (depth only with perspective), and how far
    the mask is drawn inside of the true outline [pixels]."""

    def __init__(self, view: View, model: CadModel, evidence: PoseEvidence, depth: float):
        self.view, self.model, self.evidence, self.depth = view, model, evidence, depth
        self.points = model.unit * (evidence.point_model - model.middle)

    def place(self, x: np.ndarray, vertex: np.ndarray) -> np.ndarray:
        return vertex @ self.rotation(x).T + self.translation(x)

    def rotation(self, x: np.ndarray) -> np.ndarray:
        return Rotation.from_rotvec(x[:3]).as_matrix()

    def translation(self, x: np.ndarray) -> np.ndarray:
        return x[3:-1] if len(x) == 7 else np.append(x[3:-1], -self.depth)

    def start(self) -> np.ndarray:
        """Start from the best of many rotations with points, else as the mesh lies in the world."""
        seen = self.evidence.point_pixel
        if not len(seen):
            row, column = np.nonzero(self.evidence.mask)
            return self._toward(
                Rotation.from_matrix(self.view.frame), np.array([column.mean(), row.mean()]) + 0.5
            )
        starts = [self._toward(r, seen.mean(axis=0)) for r in Rotation.create_group("O")]
        residuals = self.residuals(None, None, None, scale=0.02)
        found = [least_squares(residuals, x, x_scale="jac", max_nfev=200) for x in starts]
        return min(found, key=lambda result: result.cost).x

    def _toward(self, rotation: Rotation, pixel: np.ndarray) -> np.ndarray:
        origin, d = self.view.rays(pixel[None])
        shift = origin[0] + d[0] * (self.depth / -d[0, 2])
        shift = shift if self.view.camera.perspective else shift[:2]
        return np.concatenate([rotation.as_rotvec(), shift, [0.0]])

    def match(self, x: np.ndarray, outline: np.ndarray) -> np.ndarray:
        """Give, for each outline point, the vertex (about the middle) of the contour nearest to it."""
        rotation, translation = self.rotation(x), self.translation(x)
        corner = self.model.vertex[self.model.edge[:, 0]] @ rotation.T + translation
        sight = corner if self.view.camera.perspective else np.array([0.0, 0.0, -1.0])
        facing = [
            np.sum((self.model.face_normal[side] @ rotation.T) * sight, axis=1) < 0
            for side in self.model.side.T
        ]
        border = self.model.side[:, 0] == self.model.side[:, 1]
        ends = self.model.vertex[self.model.edge[(facing[0] != facing[1]) | border]]
        share = np.linspace(0, 1, 4)[:, None, None]
        contour = ((1 - share) * ends[:, 0] + share * ends[:, 1]).reshape(-1, 3)
        _, nearest = cKDTree(self.view.project(self.place(x, contour))).query(outline)
        return contour[nearest]

    def residuals(self, outline, across, matched, scale: float = 1.0) -> Callable:
        """Give a function of the unknowns: all misfits over their standard deviations."""
        chosen = None
        if self.evidence.normal is not None and outline is not None:
            chosen = slice(None, None, -(-len(self.model.vertex) // (4 * MOST_OUTLINE)))

        def evaluate(x):
            parts = [x[-1:] / OFFSET_SIGMA]
            if len(self.points):
                off = self.view.project(self.place(x, self.points)) - self.evidence.point_pixel
                parts.append(scale * off.ravel() / POINT_SIGMA)
            if outline is not None:
                off = np.sum((self.view.project(self.place(x, matched)) - outline) * across, axis=1)
                parts.append((off - x[-1]) / OUTLINE_SIGMA)
            if chosen is not None:
                parts.append(self._normal_misfit(x, chosen))
            return np.concatenate(parts)

        return evaluate

    def _normal_misfit(self, x: np.ndarray, chosen: slice) -> np.ndarray:
        normal = self.model.normal[chosen] @ self.rotation(x).T
        pixel = self.view.project(self.place(x, self.model.vertex[chosen])) - 0.5
        seen = np.stack(
            [map_coordinates(c, pixel[:, ::-1].T, order=1) for c in np.moveaxis(self.evidence.normal, -1, 0)],
            axis=1,
        )
        good = (normal[:, 2] > 0.3) & (np.linalg.norm(seen, axis=1) > 0.9)
        return ((normal - seen) * good[:, None]).ravel() / NORMAL_SIGMA

    def pose(self, x, residuals, outline, across, matched) -> Pose:
        result = least_squares(residuals, x, loss="cauchy", f_scale=3.0, x_scale="jac", max_nfev=20)
        x = result.x
        # the derivative by a small turn about the camera's axes, not by the rotation vector
        steps, base = 1e-5 * np.eye(len(x)), residuals(x)
        columns = []
        for k, h in enumerate(steps):
            moved = x + h
            if k < 3:
                moved[:3] = (Rotation.from_rotvec(h[:3]) * Rotation.from_rotvec(x[:3])).as_rotvec()
            columns.append((residuals(moved) - base) / 1e-5)
        jacobian = np.stack(columns, axis=1)
        weight = 1 / (1 + (base / 3.0) ** 2)
        normal = jacobian.T @ (weight[:, None] * jacobian)
        freedom = max(np.count_nonzero(base) - len(x), 1)
        covariance = np.linalg.pinv(normal) * np.sum(weight * base**2) / freedom
        sigma = np.sqrt(np.diagonal(covariance))
        off = self.view.project(self.place(x, self.points)) - self.evidence.point_pixel
        empty = np.empty((0, 2))
        contour = empty if outline is None else self.view.project(self.place(x, matched))
        across_off = np.empty(0) if outline is None else np.sum((contour - outline) * across, axis=1)
        return Pose(
            rotation=self.rotation(x),
            translation=self.translation(x),
            rotation_sigma_deg=np.degrees(sigma[:3]),
            translation_sigma=np.append(sigma[3:-1], np.zeros(7 - len(sigma))),
            point_residual=np.linalg.norm(off, axis=1),
            outline=empty if outline is None else outline,
            contour=contour,
            outline_residual=across_off - x[-1],
            outline_offset=float(x[-1]),
            outline_offset_sigma=float(sigma[-1]),
        )


def world_matrix(view: View, model: CadModel, pose: Pose) -> np.ndarray:
    """Give the matrix (4, 4) from the mesh's own coordinates to the world."""
    matrix = np.eye(4)
    turn = view.frame.T @ pose.rotation
    matrix[:3, :3] = model.unit * turn
    matrix[:3, 3] = view.point_to_world(pose.translation) - model.unit * turn @ model.middle
    return matrix
