"""Pairs of consecutive events of a pixel, the measurements that the solver explains."""

import warnings
from dataclasses import dataclass

import numpy as np

from evsdr.errors import InputError, InputWarning
from evsdr.events.pair_kernel import list_silences, pair, sort_by_pixel
from evsdr.events.phase import phase, position
from evsdr.events.photoreceptor import Photoreceptors
from evsdr.records import Recording

TOO_CLOSE_SHARE = 0.05  # of pairs within the refractory period, before a warning
CHUNK = 1 << 17  # times whose phases are computed together: they stay in the cache


@dataclass(frozen=True)
class Pairs:
    """Event pairs, pixel after pixel (row after row) and in time order within each.

    Attributes
    ----------
    offset : (n_pixel + 1,) uint32
        Pairs of pixel i = y * width + x are offset[i] .. offset[i+1].
    phase_start, phase_end : (n_pair,) float32
        Phase of the ring (slot + crossfade fraction), 0 <= phase < n_slot, when the reference intensity is
        memorised and when the event fires.
    polarity : (n_pair,) int8
        +1 (brighter) or -1 of the event that ends the pair.
    bias : (n_pair,) float32
        What is added to the change of log I: noise of photoreceptors, and a leak, make events fire early by it.
    answer : (n_pair, 2) float32, optional
        Of photoreceptors that lag: by how much log I counts at start and end. What they show follows other light than that
        of which phases and biases are to first order as this says, and these are right for that.
    n_event : int
        Events looked at.
    n_dropped : int
        Pairs left out: not within the rounds, or closer than the refractory period.
    silent_offset : (n_pixel + 1,) uint32
        Silences of pixel i in which slots start are silent_offset[i] .. silent_offset[i+1].
    silent_start, silent_end : (n_silence,) float32
        Phase at which the reference was memorised, and that of the next event or the end of the recording.
    silent_polarity : (n_silence,) int8
        Of the event that ends the silence; 0 where none does.
    silent_bias : (n_silence,) float32
        As `bias`, of the light that was memorised.
    probe_offset : (n_silence + 1,) uint32
        Probes of silence k are probe_offset[k] .. probe_offset[k+1].
    silent_probe : (n_probe,) float32
        Starts of slots that pass in silence. One longer than a round is probed for one round.
    """

    offset: np.ndarray
    phase_start: np.ndarray
    phase_end: np.ndarray
    polarity: np.ndarray
    bias: np.ndarray
    answer: np.ndarray | None
    n_event: int
    n_dropped: int
    silent_offset: np.ndarray
    silent_start: np.ndarray
    silent_end: np.ndarray
    silent_polarity: np.ndarray
    silent_bias: np.ndarray
    probe_offset: np.ndarray
    silent_probe: np.ndarray


def pair_events(
    recording: Recording,
    mask: np.ndarray | None = None,
    receptors: Photoreceptors | None = None,
    leak: float = 0.0,
) -> Pairs:
    """Pair each event with the one before it in its pixel.

    Two events at t_(k-1) and t_k say log I(t_k) - log I(t_(k-1) + refractory) = p_k C, so a pair starts at
    t_(k-1) + refractory and ends at t_k. A leak adds leak (t_k - t_(k-1) - refractory) to that.

    Parameters
    ----------
    recording : Recording
        Events in time order.
    mask : (H, W) bool, optional
        Pixels whose events count; all by default.
    receptors : Photoreceptors, optional
        What pixels show; by default log I itself. Phases are those at which the light was what they show.
    leak : float
        Rise of what the comparators see since the reference was memorised [log I per us].

    Raises
    ------
    InputError
        No pair remains.

    Warns
    -----
    InputWarning
        Many events follow another within the refractory period.
    """
    events, sensor = recording.events, recording.sensor
    if mask is None:
        mask = np.ones((sensor.height, sensor.width), bool)
    offset, p, t = sort_by_pixel(events.x, events.y, events.p, events.t, mask)
    phases = *_single_phase(t, recording), *_single_phase(t + sensor.refractory_us, recording)
    fired, fired_inside, memorised, memorised_inside = phases
    ahead = left = np.zeros(len(t), np.float32)
    answer, fixed = np.zeros((2, 0), np.float32), (0.0, 0.0)
    if receptors:
        shown = receptors.shown(offset, _positions(t, recording), 2.0 * p - 1)
        fired, memorised, ahead, left = shown.fired, shown.memorised, shown.ahead, shown.left
        answer, fixed = shown.answer, (1 - shown.answer) * shown.log
    refractory_us = float(sensor.refractory_us)
    schedule, rounds = recording.schedule, recording.round_start_us
    last_us = rounds[-1] - 1e-3 if len(rounds) > 1 else float(t.max())
    risen = _risen(offset, t, last_us, recording, leak)
    added = ahead + fixed[0], left - risen[0] + fixed[1]
    told = fired, fired_inside, memorised, memorised_inside, refractory_us, *added, answer
    pair_offset, start, end, polarity, bias, answers, n_dropped, n_close = pair(offset, p, t, *told)
    _check_pairs(len(end), n_dropped, n_close, sensor.refractory_us)
    last_phase, last_inside = (value[0] for value in _single_phase(np.array([last_us]), recording))
    silences = list_silences(
        offset,
        p,
        t,
        *phases,
        (fired, memorised, left - risen[1]),
        refractory_us,
        float(schedule.slot_us),
        len(schedule.order),
        (float(last_us), float(last_phase), bool(last_inside)),
    )
    silent_offset, silent_start, silent_end, silent_polarity, silent_bias, probe_offset, silent_probe = (
        silences
    )
    if receptors:
        silent_probe = receptors.phases(probe_offset[silent_offset], silent_probe)
    return Pairs(
        offset=pair_offset,
        phase_start=start,
        phase_end=end,
        polarity=polarity,
        bias=bias,
        answer=answers if receptors else None,
        n_event=len(t),
        n_dropped=n_dropped,
        silent_offset=silent_offset,
        silent_start=silent_start,
        silent_end=silent_end,
        silent_polarity=silent_polarity,
        silent_bias=silent_bias,
        probe_offset=probe_offset,
        silent_probe=silent_probe,
    )


def _risen(
    offset: np.ndarray, t: np.ndarray, last_us: float, recording: Recording, leak: float
) -> np.ndarray:
    """Give what a leak adds from each event to the next of its pixel or the end, and in the silence between (2, n_event).

    A slot that starts in a silence does so halfway on average; of one longer than a round only a round is probed.
    """
    if leak == 0:
        return np.zeros((2, len(t)), np.float32)
    following = np.append(t[1:], last_us).astype(float)
    following[offset[1:][offset[1:] > offset[:-1]] - 1] = last_us
    since = np.maximum(following - t - recording.sensor.refractory_us, 0)
    schedule = recording.schedule
    round_us = schedule.slot_us * len(schedule.order)
    return np.array([leak * since, 0.5 * leak * np.minimum(since, round_us)], np.float32)


def _check_pairs(n_pair: int, n_dropped: int, n_close: int, refractory_us: float) -> None:
    """Refuse recordings without pairs, and warn of a refractory period that many events contradict."""
    if not n_pair:
        raise InputError(
            "No two events of a pixel follow each other within the rounds of the ring; "
            "check the triggers or start_us, refractory_us, and the mask."
        )
    too_close = n_close / (n_pair + n_dropped)
    if too_close > TOO_CLOSE_SHARE:
        warnings.warn(
            InputWarning(
                f"{too_close:.0%} of the event pairs lie within refractory_us of the sensor, "
                f"{refractory_us:g} us; it is probably too long."
            ),
            stacklevel=3,
        )


def _single_phase(t_us: np.ndarray, recording: Recording) -> tuple[np.ndarray, np.ndarray]:
    """Give phases in float32; what rounds up to n_slot becomes 0, where the light is the same."""
    single, inside = np.empty(len(t_us), np.float32), np.empty(len(t_us), bool)
    for k in range(0, len(t_us), CHUNK):
        part = slice(k, k + CHUNK)
        single[part], inside[part] = phase(t_us[part], recording.schedule, recording.round_start_us)
    single[single >= len(recording.schedule.order)] = 0
    return single, inside


def _positions(t_us: np.ndarray, recording: Recording) -> np.ndarray:
    """Give positions (slot + the fraction of it that is over)."""
    out = np.empty(len(t_us))
    for k in range(0, len(t_us), CHUNK):
        part = slice(k, k + CHUNK)
        out[part], _ = position(t_us[part], recording.schedule, recording.round_start_us)
    return out
