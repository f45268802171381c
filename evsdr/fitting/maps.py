"""From a problem to maps: the solvers with their settings, and what their solutions look like as images."""

import numpy as np
from scipy import ndimage

from evsdr.light.scene import RingScene
from evsdr.records import Maps
from evsdr.solve.problem import Problem
from evsdr.solve.solution import Solution
from evsdr.solve.unknowns import KNOWN_SCALE, KNOWN_SIGMA_DEG, log_spread, normal_sigma_deg, to_normal

# What pixels with one normal leave out of a curved surface: radians, and share of reflectance, times the squared turn of the
# normal over a pixel [rad]. Measured by experiments.sigma: with half of them a third of the errors of spheres, reliefs and bumpy
# meshes were within one sigma, with twice as much nearly all
CURVED_NORMAL, CURVED_REFLECTANCE = 0.2, 1.0
# Of the turn of the normal over a pixel, at the object's rim: what is seen is that of a part of the pixel, and which part is not known.
# Measured as `model_error.MISFIT`: with 0 11 of 15 keep the promise, with 0.05 12, from 0.1 on 14; with 0.2 sigmas are 33 % larger for 24
RIM_TURN = 0.1
# The same of the logarithm of reflectance. Measured by hand on 24 draws, with MISFIT and `log_spread`: with 0 and 0.2 16 keep the promise,
# with 0.3 17, with 0.5 18; sigmas are 54, 55, 57 and 61 % larger than without all three
RIM_REFLECTANCE = 0.3


def assemble_maps(
    problem: Problem,
    solution: Solution,
    shape: tuple[int, int],
    ring: RingScene,
    values: tuple[np.ndarray, np.ndarray] | None = None,
) -> Maps:
    """Lay the solution out as images.

    A pixel without information keeps the values of the nearest known one, and says so in mask and sigma; one
    that events tell something of, but whose error may be too large to be known, keeps its own. A band that is
    never lit says so in sigma. With no constant light the scale of each pixel is unknown; its
    largest band is then 1.

    Parameters
    ----------
    values : (n_pixel, 3) and (n_pixel, n_band) float, optional
        Normals and reflectances that stand as they are; those of the solution by default.
    """
    theta = solution.theta.astype(float)
    normal, reflectance = values or (to_normal(theta), np.exp(theta[:, 2:]))
    sigma = normal_sigma_deg(theta[:, 0], theta[:, 1], solution.covariance[:, :2, :2])
    variance = np.diagonal(solution.covariance, axis1=1, axis2=2)
    # Of the model's error in curved pixels, the larger of what is expected and what the events show
    turn = normal_turn(normal, problem.grid.mask)
    curved = turn**2
    turned, relative = np.degrees(CURVED_NORMAL * curved), np.square(CURVED_REFLECTANCE * curved)[:, None]
    informed = problem.fired & (variance > 0).all(axis=1)  # rounding can spoil an inverse
    informed &= np.hypot(sigma, turned) < KNOWN_SIGMA_DEG
    if (error := solution.model_error) is not None:
        turned = np.maximum(turned, normal_sigma_deg(theta[:, 0], theta[:, 1], error[:, :2, :2]))
        relative = np.maximum(relative, np.diagonal(error, axis1=1, axis2=2)[:, 2:])
        at_rim = turn * rim(problem.grid.mask)
        turned = np.hypot(turned, np.degrees(RIM_TURN * at_rim))
        relative = relative + np.square(RIM_REFLECTANCE * at_rim)[:, None]
    sigma, relative = np.hypot(sigma, turned), variance[:, 2:] + relative
    reflectance_sigma = reflectance * log_spread(relative)
    if ring.constant_light == 0:
        scale = 1 / reflectance.max(axis=1, keepdims=True)
        reflectance, reflectance_sigma = reflectance * scale, reflectance_sigma * scale
    led = problem.pairs.slot_leds.numpy() & 0xFFFF
    lit = lit_bands(led, problem.illumination.band)
    reflectance_sigma[:, ~lit] = 1
    known = informed & (sigma < KNOWN_SIGMA_DEG)
    # Variance of the mean logarithm
    of_scale = solution.covariance[:, 2:, 2:][:, lit][:, :, lit].mean(axis=(1, 2))
    scaled = known & (of_scale < KNOWN_SCALE**2) & (ring.constant_light > 0)

    def image(values, elsewhere):
        out = np.full((shape[0] * shape[1], *values.shape[1:]), elsewhere, np.float32)
        out[problem.pixel] = values
        return out.reshape(*shape, *values.shape[1:])

    mask = image(known, 0) > 0
    solved = image(np.ones(len(known)), 0) > 0
    maps = Maps(
        normal=image(normal, 0),
        reflectance=image(reflectance, 0),
        mask=mask,
        normal_sigma_deg=image(np.where(known, sigma, 180), 180),
        reflectance_sigma=image(np.where(known[:, None], np.minimum(reflectance_sigma, 1), 1), 1),
        band_wavelength_nm=ring.leds.band_wavelength_nm.astype(np.float32),
        mask_reflectance=image(scaled, 0) > 0,
    )
    nearest = ndimage.distance_transform_edt(~mask, return_distances=False, return_indices=True)
    fill = (image(~informed, 0) > 0) & mask.any() & (values is None)
    maps.normal[fill] = maps.normal[tuple(nearest[:, fill])]
    maps.reflectance[fill] = maps.reflectance[tuple(nearest[:, fill])]
    maps.normal[~solved] = (0, 0, 1)
    return maps


def lit_bands(order: np.ndarray, band: list[int]) -> np.ndarray:
    """Tell which bands (n_band,) the LEDs of some slots have; numbers of no LED mean darkness."""
    order = np.asarray(order).astype(np.int64)
    lit = np.asarray(band)[order[(order >= 0) & (order < len(band))]]
    return np.isin(np.arange(max(band) + 1), lit)


def normal_turn(normal: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Give the angle by which the normal turns over each pixel (n_pixel) [rad], from its neighbours (n_pixel, 3)."""
    image = np.full((*mask.shape, 3), np.nan)
    image[mask] = normal
    square = np.zeros(mask.shape)
    for axis in (0, 1):
        step = np.linalg.norm(np.diff(image, axis=axis), axis=-1)
        sides = [np.insert(step, place, np.nan, axis=axis) for place in (0, step.shape[axis])]
        both = np.stack(sides)
        known = np.isfinite(both).sum(axis=0)
        square += (np.nansum(both, axis=0) / np.maximum(known, 1)) ** 2
    return np.sqrt(square[mask])


def rim(mask: np.ndarray) -> np.ndarray:
    """Tell which pixels of the object (n_pixel,) bool touch what is not, corners included; the film's edge is no rim."""
    return ~ndimage.binary_erosion(mask, np.ones((3, 3)), border_value=1)[mask]
