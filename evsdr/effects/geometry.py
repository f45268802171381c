"""Warnings about geometry that does not fit what was recorded."""

import warnings

import numpy as np
from scipy import ndimage

from evsdr.effects.world import World
from evsdr.errors import InputWarning
from evsdr.light.ground_truth import object_depth, object_normals
from evsdr.metrics import angular_error_deg
from evsdr.model.arrays import rows
from evsdr.records import Maps

SMALL_PIECE = 0.01  # of the mask: smaller ones are noise
MISPLACED_DEG = 15.0  # median angle between fitted normals and those of geometry that light was traced on
LEAST_COSINE = 1e-3  # of an LED that lights a surface


def check_light(world: World) -> None:
    """Warn of LEDs that light no pixel: inside the object, behind it, or hidden."""
    ring, light = world.ring, world.illumination()
    pixel = np.flatnonzero(world.mask & (object_depth(ring) > 0))
    if len(pixel) == 0:
        return
    normal = object_normals(ring).reshape(-1, 3)[pixel]
    dark = []
    for j, (direction, irradiance) in enumerate(zip(light.direction, light.irradiance)):
        toward = rows(direction)
        arriving = irradiance.numpy()
        toward, arriving = (v if len(v) == 1 else v[pixel] for v in (toward, arriving))
        faces = (
            toward[:, 2] > 0 if not ring.shape_is_known else np.sum(normal * toward, axis=-1) > LEAST_COSINE
        )
        if not (faces & (arriving > 0)).any():
            dark.append(j)
    if dark:
        which = f"LED {dark[0]} lights" if len(dark) == 1 else f"LEDs {', '.join(map(str, dark))} light"
        warnings.warn(
            InputWarning(
                f"{ring.path}: {which} no pixel of the object, by its geometry: behind it, inside it or hidden; "
                "check the positions, or use --shadows off."
            )
        )


def check_pieces(world: World) -> None:
    """Warn of an unknown shape in several pieces: normals don't tell their distance from each other."""
    if world.ring.shape_is_known and world.shadows != "estimate":
        return
    component, _ = ndimage.label(world.mask)
    size = np.bincount(component.ravel())[1:]
    pieces = np.count_nonzero(size > SMALL_PIECE * world.mask.sum())
    if pieces > 1:
        warnings.warn(
            InputWarning(
                f"{world.ring.path}: the object is seen in {pieces} pieces, whose depth relative to each other is that of the "
                "scene's object; shadows of one on another are as good as that."
            )
        )


def check_normals(world: World, maps: Maps) -> None:
    """Warn where fitted normals contradict the geometry that light was traced on."""
    ring = world.ring
    if not ring.shape_is_known or world.shadows == "estimate" or not (world.shadows == "scene" or world.near):
        return
    mask = maps.mask & (object_depth(ring) > 0)
    if not mask.any():
        return
    angle = float(np.median(angular_error_deg(maps.normal, object_normals(ring))[mask]))
    if angle > MISPLACED_DEG:
        warnings.warn(
            InputWarning(
                f"{ring.path}: fitted normals are {angle:.0f} degrees off those of the object's geometry, so light was "
                "traced on a shape that is not the one recorded; correct it, or use --shadows estimate."
            )
        )
