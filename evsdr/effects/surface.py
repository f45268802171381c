"""The surface of a fit: put in the place of the object to trace light on it, and written out."""

from collections.abc import Callable
from dataclasses import asdict
from typing import TYPE_CHECKING

import numpy as np

from evsdr.effects.memo import holder
from evsdr.light.camera import camera_geometry
from evsdr.light.ground_truth import object_depth
from evsdr.light.scene import RingScene, move_object, rectangle_corners, with_object
from evsdr.records import Maps
from evsdr.shape.depth import Depth
from evsdr.shape.traced import depth_of, surface_files, traced_mesh

if TYPE_CHECKING:
    from evsdr.effects.world import Fitted


RECTANGLE = np.array([[0, 1, 2], [0, 2, 3]])  # corners of its triangles


class FittedSurface:
    """A scene whose object is replaced by the surface of one fit after another; its mesh is made once and moved.

    It is bounded where a mask tells which pixels are the object, see `depth_of`.
    """

    def __init__(self, ring: RingScene, bounded: bool = True):
        self.ring, self.bounded = ring, bounded
        self.camera, self.to_world = camera_geometry(ring.sensor)
        self._scene: RingScene | None = None
        self._depth: Depth | None = None
        self._fitted: tuple[Callable[[], "Fitted | None"], float] = (lambda: None), 0.0  # which is not kept
        self._flat: RingScene | None = None
        self._anchor = object_depth(ring)

    def depth(self, fitted: "Fitted", nearer: float = 0.0) -> Depth:
        """Integrate the fitted normals; the surface is nearer to the camera than what stands for it."""
        mask = fitted.problem.grid.mask
        return depth_of(fitted.maps, mask, self.camera, self._anchor, self.bounded).nearer(nearer)

    @property
    def extent(self) -> float:
        """Give the width of a square as large as what stands for the surface is seen [scene units]; 0 if it is not."""
        seen = self._anchor > 0
        depth = self._anchor[seen].mean() if self.camera.perspective and seen.any() else 1.0
        return float(np.sqrt(np.count_nonzero(seen) * np.prod(self.camera.pixel_size)) * depth)

    def placeholder(self, nearer: float) -> RingScene:
        """Give the scene with the rectangle that stands for an unknown shape nearer to the camera."""
        if nearer == 0:
            return self.ring
        position = rectangle_corners(self.ring) + nearer * self.to_world[:3, 2]
        if self._flat is None:
            self._flat = with_object(self.ring, position, RECTANGLE)
        else:
            move_object(self._flat, position, RECTANGLE)
        return self._flat

    def follow(self, fitted: "Fitted", pixels: float, nearer: float = 0.0) -> tuple[RingScene, float]:
        """Give the scene with the surface of a fit, and the length of so many pixels there [scene units]."""
        last, where = self._fitted
        if fitted is not last():
            self._depth = self.depth(fitted)
        if fitted is not last() or nearer != where:
            self._fitted = holder(fitted), nearer
            position, face = traced_mesh(self._depth.nearer(nearer), self.to_world)
            if self._scene is None:
                self._scene = with_object(self.ring, position, face)
            else:
                move_object(self._scene, position, face)
        scale = self._depth.depth[self._depth.mask].mean() if self.camera.perspective else 1.0
        return self._scene, pixels * min(self.camera.pixel_size) * float(scale)

    def told(self) -> dict:
        """Say for the summary in what unit the surface is, and where the pixels of its depth look."""
        return {
            "unit": self.ring.integrator.unit or None,
            "camera": asdict(self.camera) | {"to_world": self.to_world.tolist()},
        }

    def files(self, depth: Depth, maps: Maps) -> dict:
        """Give what writes the surface's files."""
        return surface_files(depth, maps, self.to_world)
