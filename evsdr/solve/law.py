"""How far events lie from the mean of their thresholds, in standard deviations: what an event costs, and silence.

An event costs as Cauchy has it, which grows slowly: light that the model does not have makes residuals that are no
noise. Measured, against a Gaussian with a share of Student's t in its place: normals of scenes whose light is modelled
in part (soft LEDs, two spheres, shadows on an estimated depth) are 5 to 15 % better, those of spheres as good.

Silence has the probability of a Gaussian threshold, but for a share with the tails of Student's t.
"""

import drjit as dr
import numpy as np

SHARE = 0.05  # of the thresholds with the tails of Student's t; guessed: 0.02 to 0.2 do about as well
SLOWEST = (
    0.08  # thresholds per slot: light that is slower, or goes the wrong way, counts as nearly this; guessed
)
GAUSS, STUDENT = (2 * np.pi) ** -0.5, 2 / (np.pi * 3**0.5)  # densities at 0, of three degrees of freedom
TAIL = -16.0  # from which down the probability is a series in 1 / y: float32 can't tell it from 0 otherwise
MEDIAN_OF_SQUARE = 0.45494  # of a standard normal variable
SMALLEST = 1e-20  # variance of a residual
WIDEST = 0.25  # median of u^2, where thresholds are drawn evenly and above 0; derived. More is misfit
N_BALANCE = 4  # rounds from the median's variance: to 1 % of it for noise that is drawn evenly
FAR = -2.0  # from which down the curvature is that of the tangent parabola about 0


def cauchy(half_square, width):
    """Give Cauchy's cost for residuals r of r^2 / 2, and the weight of their derivatives.

    width^2 / 2 log(1 + (r / width)^2); the width is in standard deviations.
    """
    square = dr.square(width)
    excess = 2.0 * half_square / square
    return 0.5 * square * dr.log(1.0 + excess), dr.rcp(1.0 + excess)


def gaussian_share(width: float) -> float:
    """Give E[z^2 w(z)] for standard normal z and Cauchy's weight w.

    The weight of the density of event times with which it balances robust residuals of Gaussian noise on average.
    """
    z, weight = np.polynomial.hermite_e.hermegauss(80)
    return float(weight @ (z**2 / (1 + (z / width) ** 2)) / weight.sum())


def variance_of(
    residual: np.ndarray, width: float, beside: float | np.ndarray = 0.0, least: float = 0.0
) -> np.ndarray:
    """Give the variance of residuals u (..., n): by the median of |u|, or less where that is of noise without tails.

    By the median, noise that is drawn evenly looks 1.3 times as wide as it is: measured, at 20 %
    (`tests.support.foreign_pixel`), signals are then 11 % too strong, refractory periods 426 for 300 us, and normals .53 for
    .27 degrees off. So it is at most that with which robust residuals balance the density of event times: u^2 w / variance
    is on average what `gaussian_share` has for it (Huber's second proposal, Ann. Math. Statist. 35, 1964). Tails that are
    longer than a Gaussian's are of what the model does not have, and don't count: measured, in slow white light they made R
    13 % low.

    Parameters
    ----------
    residual : (..., n)
    width : float
        Of Cauchy's cost.
    beside : float or (n,)
        Variance that is known to be there beside it.
    least : float
        Smallest variance.
    """
    square, share, known = np.square(residual), gaussian_share(width), np.median(beside)
    first = whole = np.maximum(np.median(square, axis=-1) / MEDIAN_OF_SQUARE, least + known)
    for _ in range(N_BALANCE):
        z = square / np.maximum(whole[..., None] - known + beside, SMALLEST)
        weighted = np.mean(z / (1 + z / width**2), axis=-1)
        whole = np.maximum(whole * weighted / share, least + known)
    usual = np.median(first)
    shorter = np.median(whole) / usual  # of all together: a few residuals alone do not tell
    even = usual * MEDIAN_OF_SQUARE < WIDEST
    return np.maximum((first - known) * (min(shorter, 1.0) if even else 1.0), least)


def survival(y):
    """Give -log of the probability that a threshold lies above -y, minus its derivative, and a curvature of it.

    The curvature is the second derivative near 0, and that of iteratively reweighted least squares in the tail, where
    Student's t bends downward.
    """
    density, weight = _density(0.5 * dr.square(y))
    t = y / 3**0.5
    student = 0.5 + (t / (1.0 + dr.square(t)) + dr.atan(t)) / dr.pi
    far = dr.rcp(dr.minimum(y, TAIL))
    student = dr.select(y < TAIL, (3.6 * dr.square(far) - 1.0) * 3.0 * STUDENT * far**3, student)
    above = (1.0 - SHARE) * (0.5 + 0.5 * dr.erf(y / 2**0.5)) + SHARE * student
    slope = density / above
    return -dr.log(above), slope, dr.select(y < FAR, -slope / y, slope * (slope + weight * y))


def _density(half_square):
    """Give the density at r from r^2 / 2, and minus the derivative of its logarithm by that."""
    fall = dr.rcp(1.0 + 2.0 / 3.0 * half_square)
    gauss, student = (1.0 - SHARE) * GAUSS * dr.exp(-half_square), SHARE * STUDENT * dr.square(fall)
    both = gauss + student
    return both, (gauss + 4.0 / 3.0 * fall * student) / both
