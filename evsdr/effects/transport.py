"""Light and shape that depend on each other: the loop over an unknown shape, and indirect light.

Where the shape is unknown, a first fit gives normals, these a depth map, this a mesh on which light is traced anew;
then fit and geometry improve each other until the light no longer changes.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import drjit as dr
import numpy as np

from evsdr.effects.light_choice import (
    LIMIT_DEG,
    TRIAL_RAYS,
    Asked,
    Light,
    Look,
    against,
    as_far,
    blocked_share,
    look_at,
    mean_error,
    path_note,
    shadow_note,
    signals_of,
)
from evsdr.effects.world import Fitted
from evsdr.light.camera import camera_geometry
from evsdr.light.ground_truth import object_depth
from evsdr.light.scene import RingScene, move_object, with_object
from evsdr.light.tracing import trace_illumination, trace_indirect
from evsdr.model.illumination import Illumination
from evsdr.shape.depth import Depth
from evsdr.shape.traced import depth_of, surface_files, traced_mesh
from evsdr.solve import trial

ROUND_RAYS = 1  # per pixel, while light and shape change
MOST_ROUNDS = 3  # of tracing and fitting
SETTLED = 0.1  # of the first round's change, below which light has settled
N_TRIED = 300  # pixels whose events say whether shadows are there
SKIP = 0.05  # pixels: hits nearer than that are the surface itself
SURE = 0.5  # pixels: the same for the decision, as nearer hits may come of the estimate's noise


class Geometry:
    """The surface that light is traced on: the scene's own, or the mesh of an estimated depth."""

    def __init__(self, ring: RingScene, estimated: bool):
        self.ring, self.estimated = ring, estimated
        self.camera, self.to_world = camera_geometry(ring.sensor)
        self.depth: Depth | None = None
        self._traced = None if estimated else ring
        self._anchor = object_depth(ring)

    def follow(self, fitted: Fitted) -> RingScene:
        """Give the scene with the surface of a fit."""
        if not self.estimated:
            return self.ring
        self.depth = depth_of(fitted.maps, fitted.problem.grid.mask, self.camera, self._anchor)
        position, face = traced_mesh(self.depth, self.to_world)
        if self._traced is None:
            self._traced = with_object(self.ring, position, face)
        else:
            move_object(self._traced, position, face)
        return self._traced

    def skip(self, pixels: float = SKIP) -> float:
        """Give the length of a shadow ray that can't be blocked [scene units]."""
        if self.depth is None:
            return 0.0
        scale = self.depth.depth[self.depth.mask].mean() if self.camera.perspective else 1.0
        return pixels * min(self.camera.pixel_size) * float(scale)


def settle(
    ring: RingScene,
    light: Light,
    asked: Asked,
    fitted: Fitted,
    refit: Callable[[Illumination, Fitted, bool], Fitted],
    progress: Callable[[str, float], None] = lambda stage, share: None,
) -> tuple[Light, Fitted]:
    """Trace light on what was fitted and fit again, until the light no longer changes.

    Parameters
    ----------
    light : Light
        Of the first fit.
    fitted : Fitted
        The first fit.
    refit : callable (illumination, fitted, quick) -> Fitted
        Fits again from where a fit ended.
    """
    unknown = asked.shadows == "estimate" or not ring.shape_is_known
    shadows_open = asked.shadows == "estimate" or (asked.shadows == "auto" and not ring.shape_is_known)
    paths = asked.light_paths == "indirect" or (asked.light_paths == "auto" and ring.integrator.max_depth > 1)
    notes, expected = dict(light.notes), dict(light.expected)
    notes["light paths"] = path_note(asked.light_paths)
    if not (shadows_open or (unknown and light.near) or paths):
        return replace(light, notes=notes), fitted

    geometry = Geometry(ring, unknown)
    trace = partial(_trace, geometry, light.near, asked.seed)
    model = light.illumination
    look = look_at(fitted.maps)
    scene = geometry.follow(fitted)
    shadows, moved, indirect = light.shadows, False, False
    if unknown:
        plain = trace(scene, False, TRIAL_RAYS, look)
        if shadows_open:
            shadowed = trace(scene, True, 1, look, SURE)
            error = expected["cast shadows"] = mean_error(look, plain, shadowed)
            shadows = asked.shadows == "estimate" or error > LIMIT_DEG
            if asked.shadows == "auto":
                share = blocked_share(look, plain, shadowed)
                notes["cast shadows"] = shadow_note(shadows, share, error, "the estimated depth")
                if shadows and not events_agree(fitted, look, plain, shadowed):
                    shadows = False
                    notes["cast shadows"] = (
                        f"not modelled: {share:.2%} of the (pixel, LED) pairs that face each other are blocked on the "
                        "estimated depth, but events say they are not"
                    )
        if light.near:
            error = expected["depth of near LEDs"] = mean_error(look, model, plain)
            moved = error > LIMIT_DEG
            where = "estimated depth" if moved else "placeholder's depth"
            notes["LEDs"] += f"; on the {where}: the other, {against(error, moved)}"

    def traced_light(rays: int) -> Illumination:
        new = trace(scene, shadows, rays, look) if unknown and (shadows or moved) else light.illumination
        if not (indirect or paths):
            return new
        depth = ring.integrator.max_depth
        gathered = trace_indirect(scene, fitted.maps, new, depth, asked.seed, geometry.skip())
        return replace(new, indirect=gathered)

    if paths:
        with_paths = traced_light(TRIAL_RAYS)
        error = mean_error(look, replace(with_paths, indirect=None), with_paths)
        expected["indirect light"] = error
        indirect = asked.light_paths == "indirect" or error > LIMIT_DEG
        notes["light paths"] = path_note(asked.light_paths, indirect, error)
        paths = False
    if not (shadows_open and shadows or moved or indirect):
        return replace(light, notes=notes, expected=expected), fitted

    first_change = 0.0
    for round_ in range(MOST_ROUNDS):
        new = traced_light(ROUND_RAYS)
        change = mean_error(look, model, new)
        first_change = change if round_ == 0 else first_change
        if change < max(LIMIT_DEG, SETTLED * first_change):
            break
        model = new
        fitted = refit(model, fitted, True)
        look, scene = look_at(fitted.maps), geometry.follow(fitted)
        progress("light and shape", (round_ + 1) / MOST_ROUNDS)
    if unknown and shadows:
        notes["rays per pixel"] = (
            f"{asked.rays}: as many as the preset allows, {ROUND_RAYS} until light settled"
        )
    model = traced_light(asked.rays)
    fitted = refit(model, fitted, False)
    notes["rounds of light and shape"] = (
        f"{round_ + 1}: tracing anew would turn normals by {change:.2g} degrees in the last, "
        f"{first_change:.2g} in the first"
    )
    return Light(model, light.coverage, shadows, light.near, notes, expected), fitted


def events_agree(fitted: Fitted, look: Look, plain: Illumination, shadowed: Illumination) -> bool:
    """Tell whether some pixels' events are likelier if LEDs are shadowed there than if they are not.

    Shadows on an estimated shape may come of its errors, as highlights bend normals.
    """
    differs = np.abs(signals_of(look, plain) - signals_of(look, shadowed)).max(axis=1) > 0
    row = np.searchsorted(fitted.problem.pixel, look.pixel[differs])
    row = row[np.diff(fitted.problem.pairs.offset.numpy().astype(np.int64))[row] > 0]
    if len(row) == 0:
        return True
    row = np.sort(np.random.default_rng(0).permutation(row)[:N_TRIED])
    UInt32 = type(fitted.problem.pairs.offset)
    pixel = UInt32(fitted.problem.pixel[row].astype(np.uint32))
    light = _side_by_side(plain.gather(pixel), shadowed.gather(pixel), len(row))
    light = replace(light, constant_light=fitted.problem.illumination.constant_light)
    few = trial.of_pixels(fitted.problem.pairs, row)
    thresholds = fitted.solution.threshold_gain is not None
    cost = trial.costs([few, few], light, np.arange(2 * len(row)).reshape(2, -1), thresholds).sum(axis=1)
    return bool(cost[1] < cost[0])


def _side_by_side(first: Illumination, second: Illumination, n_pixel: int) -> Illumination:
    """Join the light of the same pixels in two cases."""
    Float = type(first.irradiance[0])

    def join(a, b):
        return dr.concat((a + dr.zeros(Float, n_pixel), b + dr.zeros(Float, n_pixel)))

    direction = [
        type(a)(*(join(a[k], b[k]) for k in range(3))) for a, b in zip(first.direction, second.direction)
    ]
    irradiance = [join(a, b) for a, b in zip(first.irradiance, second.irradiance)]
    return replace(first, direction=direction, irradiance=irradiance)


def _trace(
    geometry: Geometry,
    near: bool,
    seed: int,
    scene: RingScene,
    shadows: bool,
    rays: int,
    look: Look,
    skip: float = SKIP,
) -> Illumination:
    """Trace light on an estimated shape."""
    new, _ = trace_illumination(scene, rays, shadows, seed, geometry.skip(skip))
    if scene.is_near and not near:
        whole, _ = trace_illumination(scene, rays, False, seed)
        new = as_far(new, whole, look.pixel)
    return new


def surface_of(ring: RingScene, fitted: Fitted) -> dict:
    """Integrate the fitted normals; gives what writes the surface's files."""
    camera, to_world = camera_geometry(ring.sensor)
    depth = depth_of(fitted.maps, fitted.problem.grid.mask, camera, object_depth(ring))
    return surface_files(depth, fitted.maps, to_world)
