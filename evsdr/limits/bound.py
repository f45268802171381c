"""How well normals and reflectance can be known: the Cramer-Rao bound of event pairs.

The events that pixels without noise would fire are paired, and the normal equations of the solver stand at
the true maps; their inverse is the smallest covariance that an unbiased estimate from these pairs can have,
for known thresholds that scatter from event to event. Silence and the density of event times say a little
more; thresholds that have to be estimated, too, leave less.
"""

from dataclasses import dataclass, replace

import drjit as dr
import numpy as np

from evsdr.events.pairs import pair_events
from evsdr.events.pixel import EventPixel
from evsdr.events.simulator import simulate_events
from evsdr.model.illumination import Illumination
from evsdr.model.lambert import LambertianRing
from evsdr.records import Recording, Schedule, Sensor
from evsdr.solve.event_terms import normal_equations
from evsdr.solve.loss import derivative_table
from evsdr.solve.problem import make_problem
from evsdr.solve.unknowns import normal_sigma_deg, to_theta

NO_ROBUST = 1e6  # width of the Cauchy cost, in standard deviations: least squares
SINGULAR = 1e-6  # eigenvalue of the scaled matrix that float32 can't tell from 0
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
    n_pair : (height, width) int
        Event pairs that the pixel gives.
    """

    normal_sigma_deg: np.ndarray
    reflectance_sigma: np.ndarray
    n_pair: np.ndarray


def event_pair_bound(
    signal: np.ndarray,
    normal: np.ndarray,
    reflectance: np.ndarray,
    mask: np.ndarray,
    light: Illumination,
    schedule: Schedule,
    n_round: int,
    pixel: EventPixel,
) -> Bound:
    """Predict how well a recording would tell normals and reflectance.

    Parameters
    ----------
    signal : (n_led, height, width) float
        A_xj: decides when events fire.
    normal : (height, width, 3) float
        True unit normals, camera frame.
    reflectance : (height, width, n_band) float
        True band reflectance.
    mask : (height, width) bool
        Pixels that count.
    light : Illumination
        What the LEDs send; arrays of width 1 or height * width.
    schedule : Schedule
        Which LED is lit when.
    n_round : int
        Number of rounds.
    pixel : EventPixel
        Thresholds, refractory period and event noise (above 0) count.

    Returns
    -------
    Bound

    Raises
    ------
    InputError
        No pixel fires two events.
    """
    height, width = mask.shape
    ideal = replace(pixel.idealised(), event_noise=0.0)
    constant_light = float(light.constant_light[0])
    events, *_, starts = simulate_events(np.where(mask, signal, 0), constant_light, schedule, n_round, ideal)
    sensor = Sensor(
        width, height, pixel.contrast_threshold_on, pixel.contrast_threshold_off, pixel.refractory_us
    )
    recording = Recording(events, sensor, schedule, starts)
    problem = make_problem(recording, pair_events(recording, mask), light, mask)

    theta = to_theta(normal[mask], reflectance[mask], type(light.constant_light))
    p, q, *r = (np.asarray(t.numpy(), float) for t in theta)
    matrix = _information(problem, theta, pixel.event_noise)
    covariance, known = invert_information(matrix)
    angle = np.where(known[:, :2].all(axis=1), normal_sigma_deg(p, q, covariance[:, :2, :2]), 180)
    spread = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)[:, 2:]) * np.exp(r).T
    spread = np.where(known[:, 2:] & (constant_light > 0), spread, 1)

    def image(values, elsewhere):
        out = np.full((height, width, *values.shape[1:]), elsewhere)
        out[mask] = values
        return out

    return Bound(
        normal_sigma_deg=image(np.minimum(angle, 180.0), 180.0),
        reflectance_sigma=image(np.minimum(spread, 1.0), 1.0),
        n_pair=image(np.diff(problem.pairs.offset.numpy().astype(int)), 0),
    )


def _information(problem, theta: list, noise: float) -> np.ndarray:
    """Give the Fisher information (n_pixel, n_unknown, n_unknown) of slopes and log reflectances."""
    Float = type(problem.pairs.phases)
    light, n = problem.illumination, len(theta)
    signals = LambertianRing(light)(theta[0], theta[1], [dr.exp(t) for t in theta[2:]], Float(light.horizon))
    table = derivative_table(*signals, light.band, problem.n_pixel)
    _, _, triangle = normal_equations(
        table,
        problem.pairs,
        light.constant_light,
        n - 2,
        Float(noise),
        Float(NO_ROBUST),
    )
    rows, columns = np.tril_indices(n)
    matrix = np.zeros((problem.n_pixel, n, n))
    for i, j, entry in zip(rows, columns, triangle):
        matrix[:, i, j] = matrix[:, j, i] = entry.numpy()
    return matrix


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
