"""Record cases, fit them as a user would, and compare errors with sigmas."""

import time
import warnings
from dataclasses import dataclass

import numpy as np

from evsdr import InputWarning, Maps, Settings, Truth, angular_error_deg, fit, score

from .cases import Case, make
from .statistics import (
    FAR,
    Verdict,
    rank_of_angle,
    rank_of_value,
    shares_within,
    thinned,
    uniformity,
)


@dataclass(frozen=True)
class Errors:
    """Of one fit, in units of sigma where nothing else is said.

    Attributes
    ----------
    known : float
        Share of the truth's pixels that the fit knows.
    mean_deg, median_deg, rmse : float
        Over all of the truth's pixels.
    angle : (n,) float
        Of the normals of all known pixels.
    reflectance : (m, n_band) float
        Of the reflectance of all pixels whose scale is known, with its sign.
    angle_ranks, reflectance_ranks : (k,) float
        Quantiles of some pixels, far from each other; of one band of each.
    verdict : str
        What the fit says of itself; "" where it says nothing.
    seconds : float
        Of the fit.
    """

    known: float
    mean_deg: float
    median_deg: float
    rmse: float
    angle: np.ndarray
    reflectance: np.ndarray
    angle_ranks: np.ndarray
    reflectance_ranks: np.ndarray
    verdict: str = ""
    seconds: float = 0.0


@dataclass(frozen=True)
class Row:
    """All recordings of a case.

    Attributes
    ----------
    name : str
    errors : tuple of Errors
    """

    name: str
    errors: tuple[Errors, ...]

    def mean(self, name: str) -> float:
        """Give the mean of a number over the recordings."""
        return float(np.mean([getattr(error, name) for error in self.errors]))

    def z(self, name: str) -> np.ndarray:
        """Give `angle` or `reflectance` of all recordings."""
        return np.concatenate([getattr(error, name) for error in self.errors])

    def within(self, name: str) -> np.ndarray:
        """Give the shares (3,) within one, two, three sigma."""
        return shares_within(self.z(name).ravel())

    def mean_square(self, name: str) -> float:
        """Give the mean square of z."""
        return float(np.mean(np.square(self.z(name)))) if self.z(name).size else np.nan

    def beyond(self) -> int:
        """Give how many normals are beyond `FAR` sigmas."""
        return int(np.count_nonzero(self.z("angle") > FAR))

    def test(self, name: str) -> Verdict:
        """Test whether the sigmas of `angle` or `reflectance` are true."""
        return uniformity([getattr(error, f"{name}_ranks") for error in self.errors])


def run(case: Case, size: int, seeds: range) -> Row:
    """Record a case with some seeds and fit each recording with default settings."""
    return Row(case.name, tuple(run_once(case, size, seed) for seed in seeds))


def run_once(case: Case, size: int, seed: int, settings: Settings = Settings()) -> Errors:
    """Record and fit once."""
    told, recording, truth = make(case, size, seed)
    begin = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)  # not all is told as it is
        found = fit(told, recording, settings)
    return errors_of(
        found.maps, truth, seed, str(found.summary.get("verdict", "")), time.perf_counter() - begin
    )


def errors_of(
    maps: Maps, truth: Truth, seed: int, verdict: str = "", seconds: float = 0.0, factor: float = 1.0
) -> Errors:
    """Compare maps with the truth; a factor on all sigmas shows what such a one would do."""
    known = maps.mask & truth.mask
    scaled = getattr(maps, "mask_reflectance", maps.mask) & truth.mask
    angle = angular_error_deg(maps.normal, truth.normal) / maps.normal_sigma_deg / factor
    off = (maps.reflectance - truth.reflectance) / maps.reflectance_sigma / factor
    some, figures = thinned(scaled, seed), score(maps, truth)
    one_band = np.arange(np.count_nonzero(some)) % off.shape[-1]
    return Errors(
        np.count_nonzero(known) / np.count_nonzero(truth.mask),
        figures["mae_deg"],
        figures["median_deg"],
        figures["rmse"],
        angle[known],
        off[scaled],
        rank_of_angle(angle[thinned(known, seed)]),
        rank_of_value(off[some][np.arange(len(one_band)), one_band]),
        verdict,
        seconds,
    )
