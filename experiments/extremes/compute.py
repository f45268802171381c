"""Record and fit each case in a child process, so that one that ends the process is only a line of the table."""

import json
import subprocess
import sys
import time
import warnings
from collections.abc import Iterator
from dataclasses import asdict, dataclass

import numpy as np

from evsdr import InputError, angular_error_deg, jit

SECONDS = 300.0  # that a case may take
UNIT_SIGMA = 3.0


@dataclass(frozen=True)
class Result:
    """What came of a case; numbers are None where nothing is known."""

    group: str
    value: str
    state: str
    """`fitted`, `refused`, `NaN`, `error`, or what ended the process."""
    said: str = ""
    events: float = 0.0
    """Of a pixel of the object, mean."""
    known: float = 0.0
    """Share of the object's pixels."""
    mae_deg: float | None = None
    sigma_deg: float | None = None
    """Median."""
    within: float | None = None
    """Share of the known normals within three sigma."""
    scaled: float = 0.0
    """Share of the object's pixels whose reflectance is known."""
    reflectance: float | None = None
    """Mean relative error."""
    reflectance_within: float | None = None
    """Share of the known reflectances within three sigma."""
    seconds: float = 0.0


def run(names: list[str] | None, large: bool) -> Iterator[Result]:
    """Give the results of all cases, or of those of some groups."""
    jit.start()
    from .cases import cases

    wanted = [case for case in cases(large) if not names or case.group in names]
    done = 0
    while done < len(wanted):
        words = [
            "--child",
            str(done),
            *(["--large"] if large else []),
            *(["--groups", *names] if names else []),
        ]
        child = subprocess.Popen(
            [sys.executable, "-m", "experiments.extremes", *words], stdout=subprocess.PIPE, text=True
        )
        with child.stdout:
            for line in child.stdout:
                yield Result(**json.loads(line))
                done += 1
        if child.wait() and done < len(wanted):
            case = wanted[done]
            yield Result(case.group, case.value, f"ended the process ({child.returncode})")
            done += 1


def child(first: int, names: list[str] | None, large: bool) -> None:
    """Run cases from one on; print each result as a line of JSON."""
    jit.start()
    from .cases import cases

    wanted = [case for case in cases(large) if not names or case.group in names]
    for case in wanted[first:]:
        print(json.dumps(asdict(measure(case))), flush=True)


def measure(case) -> Result:
    """Record a case, fit it, and compare."""
    from evsdr import fit, load_scene, simulate

    start = time.perf_counter()
    name = case.group, case.value
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            ring = load_scene(case.scene.describe())
            recording, truth = simulate(ring, case.pixel, case.schedule(), case.rounds, thresholds="nominal")
            recording = case.alter(recording)
            found = fit(ring, recording, case.settings)
    except InputError as error:
        return Result(*name, "refused", str(error), seconds=time.perf_counter() - start)
    except Exception as error:
        return Result(
            *name, "error", f"{type(error).__name__}: {error}"[:200], seconds=time.perf_counter() - start
        )
    seconds = time.perf_counter() - start
    maps, mask = found.maps, truth.mask
    arrays = (maps.normal, maps.reflectance, maps.normal_sigma_deg, maps.reflectance_sigma)
    if not all(np.isfinite(array).all() for array in arrays):
        return Result(*name, "NaN", found.verdict, seconds=seconds)
    known, scaled = mask & maps.mask, mask & maps.mask_reflectance
    events = len(recording.events) / max(mask.sum(), 1)
    state = found.verdict.partition(":")[0]
    result = {"state": state, "said": found.verdict.partition(": ")[2], "events": events, "seconds": seconds}
    result |= {"known": share(known, mask), "scaled": share(scaled, mask)}
    if known.any():
        angle, sigma = angular_error_deg(maps.normal, truth.normal)[known], maps.normal_sigma_deg[known]
        result |= {"mae_deg": float(angle.mean()), "sigma_deg": float(np.median(sigma))}
        # an angle in two dimensions of which each has sigma / sqrt 2
        result |= {"within": float(np.mean(angle <= UNIT_SIGMA * sigma))}
    if scaled.any():
        true = truth.reflectance[scaled]
        error = np.abs(maps.reflectance[scaled] - true)
        result |= {"reflectance": float(np.mean(error / true))}
        result |= {"reflectance_within": float(np.mean(error <= UNIT_SIGMA * maps.reflectance_sigma[scaled]))}
    return Result(*name, **result)


def share(part: np.ndarray, whole: np.ndarray) -> float:
    """Give how much of a mask is in another."""
    return float(np.count_nonzero(part) / max(np.count_nonzero(whole), 1))
