"""How well normals and reflectance can be known: the limit of Cramer and Rao for the events of a ring.

The inverse of the Fisher information (`information`) is the smallest covariance that an unbiased estimate of a pixel
alone can have, without priors of its maps. What all pixels share is told, or unknown but for its tolerance: then the
Schur complement onto it says how well all pixels together tell it, and what that costs each of them.
"""

from dataclasses import dataclass, replace

import numpy as np

from evsdr.errors import InputError
from evsdr.limits.information import REPEATS, Information, Plan, average_information, theta_of
from evsdr.solve.coarse import lattice
from evsdr.solve.grid import nearest
from evsdr.solve.shared.kernel import ON
from evsdr.solve.shared.pixels import is_far
from evsdr.solve.shared.rig import Basis, Rig, Told
from evsdr.solve.threshold_spread import SMALLEST_SPREAD
from evsdr.solve.unknowns import normal_sigma_deg

SINGULAR = 1e-6  # eigenvalue of the scaled matrix that a parabola for log I can't tell from 0
MOST = 128 * 128  # pixels that are judged, of larger objects a lattice: 9 s under 48 LEDs; guessed
UNTOUCHED = 1e-4  # share of an unknown in the null directions up to which it is known all the same


@dataclass(frozen=True)
class Bound:
    """Smallest standard deviations, as images.

    Attributes
    ----------
    normal_sigma_deg : (height, width) float64
        Root mean square angle of the normal [deg]; 180 where nothing is known.
    reflectance_sigma : (height, width, n_band) float64
        Of the reflectance of each band; 1 where nothing is known, as everywhere without constant light.
    """

    normal_sigma_deg: np.ndarray
    reflectance_sigma: np.ndarray


@dataclass(frozen=True)
class Limit:
    """What a recording can tell.

    Attributes
    ----------
    told : Bound
        Of maps, if all that pixels share is told, and the thresholds of each.
    unknown : Bound
        If none of that is known better than its tolerance.
    names : tuple of str
        What is unknown then, of `rig.NAMES`.
    shared : Rig
        Standard deviations of what pixels share; 0 for what is told.
    n_pair : (height, width) float64
        Event pairs that the pixel gives, on average.
    """

    told: Bound
    unknown: Bound
    names: tuple[str, ...]
    shared: Rig
    n_pair: np.ndarray


def find_limit(plan: Plan, told: Told = Told(), repeats: int = REPEATS, seed: int = 0) -> Limit:
    """Predict how well a recording would tell normals and reflectance.

    Of objects of more than `MOST` pixels a lattice is judged; the others are as the nearest of it.

    Parameters
    ----------
    plan : Plan
    told : Told
        How well what pixels share is told; directions of LEDs by 0 are told.
    repeats, seed : int
        See `average_information`.

    Raises
    ------
    InputError
        No pixel fires two events.
    """
    names, mask = unknown_names(plan, told), plan.mask
    taken = lattice(mask, max(1, int(np.ceil(np.sqrt(mask.sum() / MOST)))))
    taken = taken if taken.any() else ~taken
    few = mask.copy()
    few[mask] = taken
    plan = replace(plan, mask=few)
    information = average_information(plan, repeats, seed, "directions" in names)
    if not information.n_pair.any():
        raise InputError("no pixel fires two events.")
    n_map = 2 + plan.light.n_band
    covariance, known = invert_information(information.own[:, :n_map, :n_map])
    for_each = len(taken) / taken.sum()
    covariances, all_known, sigma = _eliminated(plan, information, told, names, for_each)
    other = nearest(taken, mask)

    def everywhere(image: np.ndarray) -> np.ndarray:
        image[mask] = image[mask][other]
        return image

    def bound(covariance: np.ndarray, known: np.ndarray) -> Bound:
        return Bound(*map(everywhere, _bound(plan, covariance, known)))

    return Limit(
        told=bound(covariance, known),
        unknown=bound(covariances[:, :n_map, :n_map], all_known[:, :n_map]),
        names=names,
        shared=sigma,
        n_pair=everywhere(_image(few, information.n_pair, 0.0)),
    )


def unknown_names(plan: Plan, told: Told) -> tuple[str, ...]:
    """Name what pixels share, of `rig.NAMES`; the light of a lag alone tells times (see `effects.shared`)."""
    lag = ("tau", "dark", "noise", "shift") if plan.pixel.cutoff_hz else ()
    directions = ("directions",) if told.directions_deg and is_far(plan.light) else ()
    return ("powers", *lag, "refractory", "leak", "thresholds", *directions)


def _eliminated(
    plan: Plan, information: Information, told: Told, names: tuple[str, ...], for_each: float = 1.0
) -> tuple:
    """Give covariance and known of each pixel's unknowns, and the standard deviations of what pixels share.

    The logarithms of a pixel's thresholds scatter about the means that pixels share. There are `for_each` pixels like each.
    """
    own, cross, shared = information.own.copy(), information.cross.copy(), for_each * information.shared
    n_led, n_map = plan.light.n_led, 2 + plan.light.n_band
    for k in range(own.shape[1] - n_map):
        i, column = n_map + k, n_led + ON + k
        precision = max(plan.spread[k], SMALLEST_SPREAD) ** -2
        own[:, i, i] += precision
        cross[:, i, column] -= precision
        shared[column, column] += for_each * len(own) * precision
    basis, width = Basis.of(names, plan.light.band), told.tolerance(plan.schedule.slot_us)
    vectors = basis.vectors
    covariance, known = invert_information(own)
    cross = cross @ vectors
    response = covariance @ cross
    complement = vectors.T @ shared @ vectors + np.diag([width[name] ** -2 for name in basis.owner])
    complement -= for_each * np.einsum("nij,nik->jk", cross, response, optimize=True)
    left = np.linalg.inv(complement)
    covariance += response @ left @ response.swapaxes(1, 2)
    variance = np.einsum("ij,jk,ik->i", vectors, left, vectors, optimize=True)
    return covariance, known, Rig.of(np.sqrt(variance), n_led)


def _bound(plan: Plan, covariance: np.ndarray, known: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Turn the covariance of slopes and log reflectances into the images of a `Bound`."""
    theta = theta_of(plan, np.flatnonzero(plan.mask))
    angle = normal_sigma_deg(theta[:, 0], theta[:, 1], covariance[:, :2, :2])
    spread = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)[:, 2:]) * np.exp(theta[:, 2:])
    scaled = known[:, 2:] & (float(plan.light.constant_light[0]) > 0)
    angle = np.where(known[:, :2].all(axis=1), np.minimum(angle, 180.0), 180.0)
    spread = np.where(scaled, np.minimum(spread, 1.0), 1.0)
    return _image(plan.mask, angle, 180.0), _image(plan.mask, spread, 1.0)


def _image(mask: np.ndarray, values: np.ndarray, elsewhere: float) -> np.ndarray:
    out = np.full((*mask.shape, *values.shape[1:]), elsewhere)
    out[mask] = values
    return out


def invert_information(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Invert information matrices and tell which unknowns they determine.

    Parameters
    ----------
    matrix : (n_pixel, n, n) float64
        Symmetric, positive semidefinite.

    Returns
    -------
    covariance : (n_pixel, n, n) float64
        The inverse, with eigenvalues of `SINGULAR` at least once the diagonal is scaled to 1.
    known : (n_pixel, n) bool
        False for an unknown that can change without changing any measurement.
    """
    diagonal = np.diagonal(matrix, axis1=1, axis2=2)
    scale = 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1))
    value, vector = np.linalg.eigh(matrix * scale[:, :, None] * scale[:, None, :])
    known = np.einsum("xik,xk->xi", vector**2, value < SINGULAR) < UNTOUCHED
    covariance = np.einsum("xik,xk,xjk->xij", vector, 1 / np.maximum(value, SINGULAR), vector)
    return covariance * scale[:, :, None] * scale[:, None, :], known
