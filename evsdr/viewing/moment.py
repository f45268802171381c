"""What the page of a preview shows at a moment: numbers, words, and a picture of each LED."""

import base64
from dataclasses import dataclass

import numpy as np

from evsdr.page.contents import numbers
from evsdr.viewing.rounds import ON_GRID
from evsdr.viewing.sums import RATE_US, Sums

WAITING, LOCKED, UNLOCKED = "waiting", "locked", "not locked"
LATE = 1.5  # rounds without a trigger that are too many
AGREE = (
    0.88  # of events that go with their slot; measured, EVK4: 0.92 to 0.98, and 0.78 to 0.86 half a slot late
)
BRIGHTEST = 99.0  # percentile of log light that is shown white


@dataclass(frozen=True)
class Lock:
    """Whether the rounds of the ring are found in the recording, and why."""

    state: str
    words: str


def lock(sums: Sums) -> Lock:
    """Tell whether triggers and events go with the schedule."""
    if not sums.n_event:
        return Lock(WAITING, "No events have come yet.")
    seconds, every = 1e-6 * (sums.last_us - sums.first_us), 1e-3 * sums.round_us
    found = sums.triggers
    if found is None:
        if 1e3 * seconds < LATE * every or sums.n_edge:
            return Lock(WAITING, f"The first round is not over yet; one lasts {every:.6g} ms.")
        return Lock(
            UNLOCKED,
            f"No trigger came in {seconds:.1f} s: switch the camera's trigger input on, and look at the cable from the "
            "ring's pin ROUND.",
        )
    got = 1e-3 * found.round_us
    if abs(got / every - 1) > ON_GRID:
        return Lock(
            UNLOCKED, f"Triggers come every {got:.6g} ms, but a round of this schedule lasts {every:.6g} ms."
        )
    said = f"{len(found.edge_us)} triggers, every {got:.6g} ms"
    if len(found.missing):
        said += f"; {len(found.missing)} are missing"
    if not np.isnan(sums.agree):
        said += f"; {sums.agree:.0%} of the events of a pixel in a slot agree in polarity"
    if sums.agree < AGREE:
        return Lock(UNLOCKED, f"{said}: look for other light, and for pixels that can't keep up.")
    return Lock(LOCKED, f"{said}.")


def moment(sums: Sums | None, skipped: int = 0, trouble: str = "", ended: bool = False) -> dict:
    """Give what the page shows: plain numbers, texts, lists and dicts.

    Parameters
    ----------
    sums : Sums, optional
        None before a file has come.
    skipped : int
        Bytes that the preview was too late for.
    trouble : str
        What is wrong with the file.
    ended : bool
        Nothing follows.
    """
    if sums is None:
        waits = trouble or "The camera has not begun to write yet."
        return {"state": WAITING, "words": waits, "n_event": 0, "ended": ended}
    told = lock(sums)
    (off, on), begin_us = sums.rate()
    found = sums.triggers
    return {
        "state": told.state,
        "words": told.words,
        "n_event": sums.n_event,
        "n_round": sums.n_round,
        "agree": None if np.isnan(sums.agree) else round(sums.agree, 4),
        "seconds": round(1e-6 * (sums.last_us - sums.first_us), 3),
        "rate": {"step_s": 1e-6 * RATE_US, "on": _a_second(on), "off": _a_second(off)},
        "slots": dict(
            zip(("order", "off", "on"), map(numbers, (np.asarray(sums.schedule.order), *sums.per_slot)))
        ),
        "triggers": found
        and {
            "index": numbers(found.index),
            "deviation_us": numbers(np.round(found.deviation_us, 2)),
            "missing": numbers(found.missing),
        },
        "picture": picture(sums) if sums.n_round else None,
        "sharpness": sharpness(*sums.levels()) if sums.n_round else None,
        "skipped": skipped,
        "ended": ended,
    }


def sharpness(level: np.ndarray, seen: np.ndarray) -> float | None:
    """Tell how steep the edges of pictures are: root mean square step between neighbours, over that between all pixels.

    Blur lowers the first alone (the squared gradient of Krotkov 1988, over the variance, so that brightness does not count).

    Parameters
    ----------
    level : (n, height, width) float
        Log light.
    seen : (height, width) bool
        Where it is known; None comes where that is nowhere.
    """
    beside, below = seen[:, 1:] & seen[:, :-1], seen[1:] & seen[:-1]
    steps = (np.diff(level, axis=2)[:, beside], np.diff(level, axis=1)[:, below])
    step = np.concatenate([part.ravel() for part in steps])
    variance = np.var(level[:, seen], axis=1).mean() if len(step) else 0.0
    return round(float(np.sqrt(np.mean(step**2) / (2 * variance))), 4) if variance else None


def picture(sums: Sums) -> dict:
    """Give a picture of each LED: log light when it is lit, against the mean of the round; 0 where there are no events."""
    level, seen = sums.levels()
    order = np.asarray(sums.schedule.order)
    leds = np.unique(order[order >= 0])
    level = np.stack([level[order == led].mean(0) for led in leds])
    most = np.percentile(np.abs(level[:, seen]), BRIGHTEST) if seen.any() else 1.0
    shown = np.where(seen, np.rint(128 + 127 * np.clip(level / max(most, 1e-9), -1, 1)), 0).astype(np.uint8)
    return {
        "leds": numbers(leds),
        "width": sums.width,
        "height": sums.height,
        "data": base64.b64encode(shown.tobytes()).decode("ascii"),
    }


def _a_second(count: np.ndarray) -> list:
    return numbers(np.round(count / (1e-6 * RATE_US), 1))
