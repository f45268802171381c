"""All that is measured of a file of events, with a scene or without."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from evsdr.fitting.entrance import Fit
from evsdr.progress import Seconds
from evsdr.records import Recording
from evsdr.rig.repetition import Repetition
from evsdr.viewing.flicker import Flicker, find_flicker, spectrum
from evsdr.viewing.leds import Leds, find_leds, slot_counts
from evsdr.viewing.pixels import Pixels, look_at_pixels
from evsdr.viewing.rounds import Triggers, find_triggers
from evsdr.viewing.sample import Sample, take_sample
from evsdr.viewing.scene import Expected, expected_accuracy, quick_fit
from evsdr.viewing.schedule import ScheduleFit, fit_schedule
from evsdr.viewing.source import Watched


@dataclass(frozen=True)
class Look:
    """What was measured; None for what needs a schedule, or a scene, that is not told.

    Attributes
    ----------
    watched : Watched
    pixels : Pixels
    triggers : Triggers, optional
    sample : Sample
    period_us : float
        Shortest time after which events come again; 0 if there is none.
    rounds : ScheduleFit, optional
    leds : Leds, optional
    flicker : Flicker, optional
    beat : tuple of (n_hz,) float
        Frequencies, and how far events keep time with each: those against the grain where a schedule is told, else all.
    per_slot : (2, n_slot) int, optional
        OFF and ON events.
    fit : Fit, optional
    expected : Expected, optional
    """

    watched: Watched
    pixels: Pixels
    triggers: Triggers | None
    sample: Sample
    period_us: float
    rounds: ScheduleFit | None
    leds: Leds | None
    flicker: Flicker | None
    beat: tuple[np.ndarray, np.ndarray]
    per_slot: np.ndarray | None
    fit: Fit | None = None
    expected: Expected | None = None

    @cached_property
    def recording(self) -> Recording:
        """Give the recording under the schedule that is believed."""
        return self.watched.recording(self.rounds.schedule, self.rounds.starts)

    @property
    def begin_us(self) -> float:
        """Give the start of the first round [us]."""
        starts = self.rounds.starts
        return float(starts[0]) if len(starts) else self.rounds.schedule.start_us

    @property
    def n_round(self) -> int:
        """Count the whole rounds."""
        if len(self.rounds.starts):
            return len(self.rounds.starts) - 1
        schedule = self.rounds.schedule
        turns = (self.watched.events.t[-1] - self.begin_us) / (schedule.slot_us * len(schedule.order))
        return int(np.ceil(turns - 0.5))  # no event marks the end of the last

    @property
    def noisy(self) -> bool:
        """Whether the best maps explain the events badly."""
        if self.fit is None:
            return False
        from evsdr.effects.doubts import NOISY  # a fit has started Mitsuba

        return self.fit.solution.noise > NOISY


def look_at(watched: Watched, ring=None, stages: Seconds | None = None) -> Look:
    """Measure a file of events.

    Parameters
    ----------
    watched : Watched
    ring : RingScene, optional
        The scene, see `evsdr.load_scene`; it is only heard where a schedule is told.
    stages : Seconds, optional
        Told what is under way.
    """
    stages = stages or Seconds()
    told = watched.schedule
    with stages.stage("look at pixels"):
        pixels = look_at_pixels(watched)
        sample = take_sample(watched.events, watched.shape, pixels.hot)
    with stages.stage("look for rounds"):
        triggers = find_triggers(watched.edges, told.slot_us * len(told.order) if told else None)
        repetition = Repetition(watched.events, watched.shape)
        measured = watched, pixels, triggers, sample, repetition.shortest()[0]
    if told is None or not len(sample):
        beat = spectrum(watched.events.t, 2 * watched.events.p - 1, watched.events.t)
        return Look(*measured, None, None, None, beat, None)
    with stages.stage("look for other light"):
        if triggers is None and len(watched.starts):
            told = replace(told, start_us=float(watched.starts[0]))
        rounds = fit_schedule(told, triggers, sample, repetition)
        believed = rounds.schedule, rounds.starts
        flicker = find_flicker(sample, *believed)
        counts = slot_counts(watched.events, *believed)
        beat = flicker.hz, flicker.beat
        look = Look(*measured, rounds, find_leds(sample, *believed), flicker, beat, counts)
    return with_scene(look, ring, stages) if ring is not None else look


def with_scene(look: Look, ring, stages: Seconds) -> Look:
    """Add what a scene tells."""
    with stages.stage("fit quickly") as advance:
        found = quick_fit(ring, look.recording, advance)
    with stages.stage("expected accuracy"):
        contradicted = look.rounds.wrong or found.contradicted
        expected = None if contradicted else expected_accuracy(ring, look.recording, found, look.n_round)
    return replace(look, fit=found, expected=expected)
