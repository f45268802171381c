"""How long a round of the ring truly takes, as triggers or events tell it: each pixel does about the same in every round.

The time from an event to those of the same pixel and polarity k rounds later scatters around k round lengths T, as light
repeats exactly and thresholds nearly do. T maximises

    S(T) = sum over k and pairs of exp(-(t_j - t_i - k T)^2 / (2 s^2)),

the sum of each pixel's autocorrelation around the multiples of T. Times of two rounds have the same distribution, so
it is symmetric about its maximum, whatever the scene.
"""

from dataclasses import dataclass

import numpy as np

from evsdr.records import Recording

REACH = 0.02  # of a round: farther off nothing is looked for; resonators are within 0.005
BLUR = 0.1  # slots, s; measured: 0.05 to 0.3 tell it about as well, narrower ones not in small recordings
MOST_EVENTS = 150_000  # that are looked at; guessed: these tell a round to 10 ppm
WIDE = 5.0  # s, within which pairs count
# Rounds apart that the search looks at, then as many times farther each time; lags at a time
FARTHER, MOST_LAGS = 6, 12
HOT = 8.0  # times as many events as the median pixel that fires has are no light's; guessed
PEAKED = 6.0  # standard deviations by which S must be peaked at all; measured: at the highest of chance peaks 3 to 5
# Slots by which events of the last round may be late as no two rounds are quite alike; measured
ALIKE = 0.002
N_STEP = 20  # of Newton's method


def unevenness(number: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Give how far times (n,) [us] of numbered rounds lie from the line through those before and after them, (n - 2,).

    It is scaled so that its standard deviation is that of a single time.
    """
    number, t = np.asarray(number, float), np.asarray(t, float)
    share = (number[1:-1] - number[:-2]) / (number[2:] - number[:-2])
    off = t[1:-1] - (1 - share) * t[:-2] - share * t[2:]
    return off / np.sqrt(1 + share**2 + (1 - share) ** 2)


def root_mean_square(value: np.ndarray) -> float:
    """Give it; 0 of nothing."""
    return float(np.sqrt(np.mean(value**2))) if len(value) else 0.0


@dataclass(frozen=True)
class Period:
    """What the events tell of a round.

    Attributes
    ----------
    ratio : float
        Its length over the told one.
    sigma : float
        One standard deviation of that.
    """

    ratio: float
    sigma: float


def find_period(recording: Recording) -> Period | None:
    """Give the length of a round; None if the events don't tell it.

    Parameters
    ----------
    recording : Recording
        Rounds that run on from the first trigger, or `start_us`, by `slot_us`.
    """
    schedule = recording.schedule
    round_us, blur = schedule.slot_us * len(schedule.order), BLUR * schedule.slot_us
    group, t = _chosen(recording)
    n_round = int(np.ptp(t) / round_us + 0.5) if len(t) else 0
    if n_round < 2:
        return None
    most, found_us = min(n_round - 1, FARTHER), None
    true_us = round_us * (1 + _coarse(group, t, np.arange(1, most + 1), round_us, blur))
    while most:
        lags = np.unique(np.linspace(1, most, MOST_LAGS).astype(int))
        away, lag, which = _pairs(group, t, lags, true_us, np.full(len(lags), WIDE * blur))
        room = np.maximum(t.max() - lag * true_us, 2 * WIDE * blur)
        found_us = _refined(away, lag, which // 2, blur, room)
        if found_us is None:
            return None
        true_us += found_us[0]
        most = min(FARTHER * most, n_round - 1) if most < n_round - 1 else 0
    sigma = np.hypot(found_us[1] / round_us, ALIKE * schedule.slot_us / t.max())
    return Period(float(true_us / round_us), float(sigma))


def _chosen(recording: Recording) -> tuple[np.ndarray, np.ndarray]:
    """Give pixel and polarity in one number, and time, of the events of some pixels, sorted by both."""
    from evsdr.events.chosen import count_events, events_of  # late, so that the help of a command is quick

    events, begin = recording.events, recording.schedule.start_us
    begin = recording.round_start_us[0] if len(recording.round_start_us) else begin
    begin += recording.schedule.slot_us  # in the first slot events are not yet as in later rounds
    n_pixel = recording.sensor.width * recording.sensor.height
    count = count_events(events, (recording.sensor.height, recording.sensor.width))
    kept = (np.random.default_rng(0).random(n_pixel) < MOST_EVENTS / max(len(events), 1)).reshape(count.shape)
    kept &= count <= HOT * np.median(count[count > 0])
    events = events_of(events, kept)
    some = events.t >= begin
    pixel = events.y[some].astype(np.int64) * recording.sensor.width + events.x[some]
    group, t = 2 * pixel + events.p[some], events.t[some] - begin
    order = np.lexsort((t, group))
    return group[order], t[order].astype(float)


def _pairs(
    group: np.ndarray, t: np.ndarray, lags: np.ndarray, round_us: float, reach_us: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Give how far events of a group lie from being lags apart, within the reach of each; the lag, and the group."""
    key = group * (4 * t.max() + 1) + t
    away, lag, which = [], [], []
    for k, reach in zip(lags, reach_us):
        first, end = (np.searchsorted(key, key + k * round_us + sign * reach) for sign in (-1, 1))
        count = end - first
        i = np.repeat(np.arange(len(t)), count)
        j = np.arange(len(i)) - np.repeat(np.cumsum(count) - count - first, count)
        away.append(t[j] - t[i] - k * round_us)
        lag.append(np.full(len(i), k))
        which.append(group[i])
    return tuple(np.concatenate(part) for part in (away, lag, which))


def _coarse(group: np.ndarray, t: np.ndarray, lags: np.ndarray, round_us: float, blur: float) -> float:
    """Give the relative deviation, within `REACH`, at which S is greatest."""
    from scipy.ndimage import gaussian_filter1d  # late, so that the help of a command is quick

    reach = REACH * lags * round_us + WIDE * blur
    away, lag, _ = _pairs(group, t, lags, round_us, reach)
    step = blur / 4
    deviation = np.arange(-REACH, REACH, step / (lags[-1] * round_us))
    total = np.zeros(len(deviation))
    for k, most in zip(lags, reach):
        n = int(most / step) + 1
        count = np.bincount((away[lag == k] / step + n + 0.5).astype(int), minlength=2 * n + 1)
        smooth = gaussian_filter1d(count.astype(float), blur / step)
        total += np.interp(deviation * k * round_us, step * np.arange(-n, n + 1), smooth[: 2 * n + 1])
    return float(deviation[total.argmax()])


def _refined(
    away: np.ndarray, lag: np.ndarray, pixel: np.ndarray, blur: float, room: np.ndarray
) -> tuple[float, float] | None:
    """Find by Newton's method what a round is longer, and its standard deviation [us]; None if S has no peak there.

    The latter is the sandwich of White (1982), with the pixels as clusters. `room` is the time in which the first event of
    a pair may lie: a little less the farther apart they are.
    """
    moved, fair = 0.0, room / (room - away)
    for _ in range(N_STEP):
        u = (away - lag * moved) / blur
        weight = fair * np.exp(-0.5 * u * u)
        slope, bend = lag * u * weight, lag**2 * (1 - u * u) * weight
        if bend.sum() <= 0:
            return None
        step = np.clip(blur * slope.sum() / bend.sum(), -blur / lag.max(), blur / lag.max())
        moved += step
    slopes, bends = (np.bincount(pixel, part) for part in (slope, bend))
    if bends.sum() < PEAKED * np.sqrt(np.sum(bends**2)):
        return None
    return moved, blur * np.sqrt(np.sum(slopes**2)) / bends.sum()
