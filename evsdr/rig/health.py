"""Tell in figures and plain sentences whether a recording is good enough to be fitted."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter

from evsdr.records import Recording

RATE_LIMIT = 40e6  # events per second: an EVK's link carries 1.6 Gbit/s, EVT3 takes 40 bits for a lone event
RATE_BIN_US = 1000
HOT_FACTOR = 10  # times the median of its 3 x 3 neighbours
HOT_LEAST = 20  # events per round
FEW, MANY = 5, 400  # events per lit pixel and round
BALANCE = 2.0  # of the change of log intensity, ON to OFF


@dataclass(frozen=True)
class Health:
    """Figures of a recording.

    Attributes
    ----------
    n_event, n_round : int
    seconds : float
        Length of the rounds [s].
    peak_rate : float
        Most events within 1 ms, per second.
    lit_share : float
        Share of the pixels with a tenth of an event per slot or more.
    events_per_pixel_round : float
        Median over the lit pixels.
    n_hot : int
        Pixels that fire far more than their neighbours.
    on_share : float
        Share of ON events.
    balance : float
        Change of log intensity told by the ON events over that told by the OFF events; 1 for periodic light.
    """

    n_event: int
    n_round: int
    seconds: float
    peak_rate: float
    lit_share: float
    events_per_pixel_round: float
    n_hot: int
    on_share: float
    balance: float


def examine(recording: Recording, n_round: int, begin_us: float, end_us: float) -> Health:
    """Compute the figures of a recording.

    Parameters
    ----------
    recording : Recording
        Events of the rounds alone.
    n_round : int
        Number of rounds.
    begin_us, end_us : float
        Start of the first and end of the last [us].
    """
    events, sensor = recording.events, recording.sensor
    pixel = events.y.astype(np.int64) * sensor.width + events.x
    count = np.bincount(pixel, minlength=sensor.width * sensor.height).reshape(sensor.height, sensor.width)
    lit = count >= max(1, 0.1 * n_round * len(recording.schedule.order))
    per_ms = np.bincount((events.t - int(begin_us)) // RATE_BIN_US)
    hot = count > HOT_FACTOR * median_filter(count, 3, mode="nearest") + HOT_LEAST * n_round
    on = float(events.p.mean())
    c_on, c_off = (float(np.mean(getattr(sensor, f"contrast_threshold_{name}"))) for name in ("on", "off"))
    return Health(
        n_event=len(events),
        n_round=n_round,
        seconds=1e-6 * (end_us - begin_us),
        peak_rate=float(per_ms.max()) * 1e6 / RATE_BIN_US,
        lit_share=float(lit.mean()),
        events_per_pixel_round=float(np.median(count[lit])) / n_round if lit.any() else 0.0,
        n_hot=int(np.count_nonzero(hot)),
        on_share=on,
        balance=on * c_on / ((1 - on) * c_off) if on < 1 else np.inf,
    )


def rows(health: Health) -> list[tuple[str, str]]:
    """Give the figures as lines of a table."""
    return [
        ("events", f"{health.n_event:,}"),
        ("rounds", f"{health.n_round} in {health.seconds:.2f} s"),
        ("events per second, mean", f"{1e-6 * health.n_event / health.seconds:.2f} M"),
        ("events per second, busiest ms", f"{1e-6 * health.peak_rate:.2f} M"),
        ("lit pixels", f"{health.lit_share:.1%}"),
        ("events per lit pixel and round", f"{health.events_per_pixel_round:.1f}"),
        ("ON events", f"{health.on_share:.1%}"),
        ("hot pixels", f"{health.n_hot:,}"),
    ]


def hints(health: Health, recording: Recording) -> list[str]:
    """Give plain sentences on what to do better; none if nothing stands out."""
    found = []
    if health.lit_share < 0.05:
        found.append(
            f"Only {health.lit_share:.1%} of the pixels see the ring: move closer, or cut the "
            "object out by --crop."
        )
    if health.lit_share and health.events_per_pixel_round < FEW:
        found.append(
            f"A lit pixel fires {health.events_per_pixel_round:.1f} times per round, which is little for its "
            "ten unknowns: lower the thresholds or the constant light, or put dark slots into the order."
        )
    if health.events_per_pixel_round > MANY:
        found.append(
            f"A lit pixel fires {health.events_per_pixel_round:.0f} times per round, more than a ring can "
            "cause: look for flickering room light or a trembling table, and raise the thresholds."
        )
    if health.peak_rate > RATE_LIMIT:
        found.append(
            f"The busiest millisecond has {1e-6 * health.peak_rate:.0f} million events per second, near what "
            "the camera's link carries, and events get lost there: crop the sensor, fade slower, or raise "
            "the thresholds."
        )
    if not 1 / BALANCE < health.balance < BALANCE:
        told = f"{health.balance:.2g} times" if np.isfinite(health.balance) else "infinitely"
        found.append(
            f"The ON events tell {told} the change of light that the OFF events tell, though the ring's "
            "light is periodic: steps are lost in the refractory period (fade slower), or the thresholds are "
            "not the true ones."
        )
    if recording.schedule.crossfade < 0.5:
        found.append(
            f"The crossfade is {recording.schedule.crossfade:g}: hard switches lose events in the refractory "
            "period; a crossfade of 1 over 10 ms or more keeps them."
        )
    if health.n_hot > 1e-3 * recording.sensor.width * recording.sensor.height:
        found.append(f"{health.n_hot:,} pixels fire far more than their neighbours: mask them in the camera.")
    if health.n_round < 3:
        found.append(f"It has {health.n_round} round(s); five or more average the noise.")
    return found
