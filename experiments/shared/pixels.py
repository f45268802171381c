"""Event pixels of other hands' physics: the default fit beside the published decoder, and what it found they share."""

import time

import numpy as np
from rich.console import Console
from rich.table import Table

import evsdr
from tests.support.foreign_pixel import ForeignPixel
from tests.support.foreign_recordings import SCENE, WATCHED, Report, judge, record

HEAD = ("", "events", "ours: angle", "RMSE", "R / true", "% within 1 2 3 sigma", "R")
DECODER = ("decoder: angle", "RMSE")
FOUND = ("tau [us]", "dark light", "noise", "C_on / told", "C_off / told")


def report(some: str, size: int, seeds: int) -> None:
    """Fit recordings of each pixel whose name holds `some`, and print the table of means over them."""
    evsdr.load_scene(SCENE, size=8)  # starts Mitsuba
    table = Table(
        *HEAD, *DECODER, *FOUND, "CPU s", title="Event pixels by other hands: found | true +- sigma"
    )
    for name, watched in WATCHED.items():
        if some in name:
            begin = time.process_time()
            recordings = [record(watched, size, seed) for seed in range(seeds)]
            ours = [judge(*recording) for recording in recordings]
            theirs = [judge(*recording, solver="adam") for recording in recordings]
            n_event = np.mean([len(recording.events) for _, recording, _ in recordings])
            cells = row(n_event, ours, theirs, watched.pixel)
            table.add_row(name, *cells, f"{(time.process_time() - begin) / seeds:.0f}")
            Console(stderr=True).print(f"{name}: done")
    Console(width=None if Console().is_terminal else 200).print(table)


def row(n_event: float, ours: list[Report], theirs: list[Report], pixel: ForeignPixel) -> tuple[str, ...]:
    """Write the cells of one pixel: means over recordings, and what the first tells of what its pixels share."""

    def mean(reports: list[Report], name: str):
        return np.mean([getattr(report, name) for report in reports], axis=0)

    return (
        f"{n_event:.0f}",
        f"{mean(ours, 'mae_deg'):.2f}",
        f"{mean(ours, 'rmse'):.4f}",
        f"{mean(ours, 'reflectance_ratio'):.3f}",
        *(percent(mean(ours, name)) for name in ("within", "reflectance_within")),
        f"{mean(theirs, 'mae_deg'):.2f}",
        f"{mean(theirs, 'rmse'):.4f}",
        *shared(ours[0].fit, pixel),
    )


def shared(fit: evsdr.Fit, pixel: ForeignPixel) -> tuple[str, ...]:
    """Write what was found and what is true; empty where nothing was, or no lag and no noise."""
    answer, lag = fit.decisions["LED powers"].answer, fit.decisions["photoreceptor lag"]
    if answer is None:
        return ("",) * len(FOUND)
    rig, sigma = answer.inferred.rig, answer.inferred.sigma
    noise = (2 * pixel.tau_us * pixel.photons_per_us) ** -0.5 if pixel.photons_per_us else 0.0
    (tau, tau_sigma), factor = answer.us("tau"), np.exp(rig.log_threshold)
    cells = [
        (tau, pixel.tau_us, tau_sigma),
        (rig.dark, pixel.lag_light, sigma.dark),
        (rig.noise, noise, sigma.noise),
    ]
    told = (pixel.on, pixel.mismatch_on), (pixel.off, pixel.mismatch_off)
    for k, (mean, spread) in enumerate(told):
        cells.append((factor[k], np.exp(-0.5 * (spread / mean) ** 2), factor[k] * sigma.log_threshold[k]))
    written = [f"{value:.3g} | {true:.3g} +- {sigma:.1g}" for value, true, sigma in cells]
    return tuple(written if lag.modelled else ["", "", "", *written[3:]])


def percent(shares: np.ndarray) -> str:
    """Write shares."""
    return " ".join(f"{100 * share:.0f}" for share in shares)
