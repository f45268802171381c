"""What the unknowns of a pixel mean."""

import numpy as np

from evsdr.solve import levenberg


def to_theta(normal: np.ndarray, reflectance: np.ndarray, Float: type) -> list:
    """Give slopes and log reflectances as Dr.Jit arrays of a type."""
    nz = np.maximum(normal[:, 2], 1 / levenberg.LARGEST_SLOPE)
    columns = [-normal[:, 0] / nz, -normal[:, 1] / nz]
    columns += list(np.log(np.maximum(reflectance, np.exp(levenberg.LOG_REFLECTANCE_RANGE[0]))).T)
    return [Float(np.ascontiguousarray(c, np.float32)) for c in columns]


def normal_sigma_deg(p: np.ndarray, q: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Turn the covariance (n, 2, 2) of slopes into the standard deviation of the normal's angle [deg].

    The root of the trace of the normal's covariance: the root mean square angle.
    """
    h2 = 1 + p**2 + q**2
    # |dn|^2 of a change of slopes is the metric of the sphere in these coordinates
    metric = np.stack([[1 + q**2, -p * q], [-p * q, 1 + p**2]]) / h2**2
    variance = np.einsum("ijn,nij->n", metric, covariance)
    return np.degrees(np.sqrt(np.maximum(variance, 0)))
