"""Fit recordings to one tolerance after another."""

import time
import warnings
from dataclasses import dataclass, replace

from evsdr import EventPixel, InputWarning, Settings, fit, load_scene, score, simulate
from experiments.fitting import SCENES

TOLERANCES = (1.0, 0.3, 0.1, 0.03, 0.01)


@dataclass(frozen=True)
class Result:
    """One fit: errors, steps, how the solver ended, and seconds of all cores."""

    mae_deg: float
    rmse: float
    n_step: int
    result: str
    seconds: float


def run(scene: str, size: int, seeds: range, tolerances=TOLERANCES) -> dict[float, list[Result]]:
    """Fit recordings of a scene to each tolerance.

    An event pixel with 10 % noise on every threshold records them, and tells one value for all.

    Parameters
    ----------
    scene : str
        Name of a scene of `scenes/`.
    size : int
        Width and height [pixels].
    seeds : range
        Of the recordings.
    tolerances : sequence of float
        Gains in log likelihood of a pixel that are worth another step.
    """
    ring = load_scene(SCENES / f"{scene}.xml", size=size)
    pixel = replace(EventPixel().idealised(), event_noise=0.1)
    found = {tolerance: [] for tolerance in tolerances}
    for seed in (seeds[0], *seeds):  # the first fits compile, and don't count
        recording, truth = simulate(ring, pixel, seed=seed, thresholds="nominal")
        for tolerance in tolerances:
            start = time.process_time()
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", InputWarning)
                fitted = fit(ring, recording, Settings(gloss="off", tolerance=tolerance))
            seconds = time.process_time() - start
            errors, solution = score(fitted.maps, truth), fitted.solution
            found[tolerance].append(
                Result(errors["mae_deg"], errors["rmse"], solution.n_step, solution.result, seconds)
            )
    return {tolerance: results[1:] for tolerance, results in found.items()}
