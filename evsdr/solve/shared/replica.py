"""What a search for what pixels share is off by, as a search in events simulated at what it found shows.

The likelihood that is searched is not quite that of events: noise that fires them early and is kept in their references, light
that turns while a photoreceptor follows. Of what comes of that a search in simulated events finds the same again, where the
truth is known: found - truth of these is taken off what was found (bias-corrected bootstrap, Efron and Tibshirani 1993,
ch. 10; of one sample). What the simulated pixel lacks it does not tell.
"""

from dataclasses import replace

import numpy as np

from evsdr.events.pixel import EventPixel
from evsdr.events.simulator import FixedPattern, find_crossings
from evsdr.records import Events, Recording
from evsdr.solve.shared.pixels import Pixels, events_of
from evsdr.solve.shared.rig import Rig

SHORTEST_US = 0.5  # of a lag that is simulated; guessed: less changes no event
LEAST_NOISE = 1e-4  # the same of its noise; guessed
LONGEST = 1e7  # time constants that pass, under the brightest light: a second of work where photoreceptors are noisy; measured
WIDEST = 0.4  # scatter of the thresholds that is simulated; guessed


def takes_long(pixels: Pixels, recording: Recording, theta: np.ndarray, rig: Rig) -> bool:
    """Tell whether noise of photoreceptors would take long to simulate: arguments as of `replica`."""
    brightest = pixels.signals(theta[:, : 2 + pixels.light.n_band], rig)[:, 0].max()
    slots = _n_round(recording) * len(recording.schedule.order)
    return rig.tau > 0 and brightest * slots / rig.tau > LONGEST


def replica(
    pixels: Pixels,
    recording: Recording,
    theta: np.ndarray,
    rig: Rig,
    scatter: float,
    departs: float,
    seed: int = 0,
) -> Pixels | None:
    """Give the same pixels with events simulated at some values.

    Parameters
    ----------
    pixels : Pixels
    recording : Recording
        Theirs, of which the replica has the rounds, one after the other.
    theta, rig, scatter, departs
        See `posterior.Start`. A dark current is not simulated.

    Returns
    -------
    Pixels
        None if none of them fires.
    """
    rng, n_map, slot_us = np.random.default_rng(seed), 2 + pixels.light.n_band, pixels.slot_us
    n, n_led = len(theta), pixels.light.n_led
    signals = pixels.signals(theta[:, :n_map], rig)[:, 0] * np.exp(departs * rng.standard_normal((n, n_led)))
    gains = theta[:, n_map:] if theta.shape[1] > n_map else rig.log_threshold
    threshold = (pixels.threshold * np.exp(gains)).astype(np.float32)
    tau_us = rig.tau * slot_us
    rate = 1 / tau_us if tau_us > SHORTEST_US else 0.0
    pixel = EventPixel.ideal(refractory_us=rig.refractory * slot_us)
    pixel = replace(
        pixel,
        event_noise=min(scatter, WIDEST),
        cutoff_hz=1e6 * rate / (2 * np.pi),
        photon_rate_per_us=rate / (2 * rig.noise**2) if rig.noise > LEAST_NOISE else 0.0,
    )
    fixed = FixedPattern(
        threshold[None, :, 0],
        threshold[None, :, 1],
        np.full((1, n), rig.leak / slot_us),
        rng.integers(0, 2**64, (1, n), np.uint64),
    )
    schedule = replace(recording.schedule, start_us=0.0)
    round_us, n_round = slot_us * len(schedule.order), _n_round(recording)
    veil = float(pixels.light.constant_light[0])
    fired = find_crossings(np.ascontiguousarray(signals.T)[:, None], veil, schedule, n_round, pixel, fixed)
    if len(fired.t_us) == 0:
        return None
    t = np.rint(fired.t_us + rig.shift * slot_us).astype(np.int64)
    order = np.argsort(t, kind="stable")
    x, p = fired.pixel[order].astype(np.uint16), (fired.polarity[order] > 0).astype(recording.events.p.dtype)
    new = replace(
        recording,
        events=Events(x, np.zeros(len(x), np.uint16), p, t[order]),
        sensor=replace(recording.sensor, width=n, height=1),
        schedule=schedule,
        round_start_us=np.rint(np.arange(n_round + 1) * round_us).astype(np.int64),
    )
    return replace(pixels, events=events_of(new, np.arange(n)))


def _n_round(recording: Recording) -> int:
    """Give the rounds of a recording, those without triggers up to the last event."""
    schedule, starts = recording.schedule, recording.round_start_us
    if len(starts) > 1:
        return len(starts) - 1
    since = recording.events.t.max() - schedule.start_us
    return max(1, int(np.ceil(since / (schedule.slot_us * len(schedule.order)))))
