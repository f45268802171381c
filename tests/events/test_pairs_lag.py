"""Pairs of photoreceptors that lag: they start and end where the light was what they show."""

import numpy as np
import pytest

from evsdr.events.pairs import pair_events
from evsdr.events.photoreceptor import Photoreceptors, Shown
from evsdr.events.pixel import EventPixel
from evsdr.events.simulator import simulate_events
from evsdr.records import Events, Recording, Schedule, Sensor
from tests.support.pixel_light import ring
from tests.support.sphere import NO_FLAWS

CUTOFF_HZ, SLOT_US, REFRACTORY_US = 3000.0, 2000.0, 40.0
TAU_SLOTS = 1e6 / (2 * np.pi * CUTOFF_HZ) / SLOT_US


class Late:
    """Photoreceptors that are a quarter of a slot late; noise of events tells their number."""

    def shown(self, offset, position, polarity):
        np.testing.assert_array_equal(offset, 3 * (np.arange(9) > 5))
        fired = self._late(position)
        number = np.arange(3, dtype=np.float32)
        added = polarity * (1 + number), polarity * number / 8
        answer = np.stack([1 + number / 4, 2 - number / 4])
        return Shown(fired, self._late(position + 0.3), *added, answer, np.stack([number, 5 - number]))

    def phases(self, offset, position):
        np.testing.assert_array_equal(offset, 3 * (np.arange(9) > 5))
        return self._late(position)

    def _late(self, position):
        return ((position - 0.25) % 4).astype(np.float32)


def test_what_photoreceptors_show_counts_everywhere():
    """By hand: slots of 100 us, refractory period 30 us, one round of four."""
    t = np.array([50, 130, 310])
    places = np.full(3, 1, np.uint16), np.full(3, 1, np.uint16)
    events = Events(*places, np.array([1, 1, 0], np.int8), t)
    schedule, rounds = Schedule(np.arange(4, dtype=np.int32), 100.0, 1.0), np.array([0, 400])
    recording = Recording(events, Sensor(4, 2, 0.2, 0.2, 30.0), schedule, rounds)
    pairs = pair_events(recording, None, Late())
    np.testing.assert_allclose(pairs.phase_start, [0.8 - 0.25, 1.6 - 0.25], rtol=1e-6)
    np.testing.assert_allclose(pairs.phase_end, [1.3 - 0.25, 3.1 - 0.25], rtol=1e-6)
    # what noise adds, and what is left of log I where it counts other than once
    np.testing.assert_allclose(pairs.answer, [[2, 1.25], [1.75, 1.5]])
    np.testing.assert_allclose(pairs.bias, [2 - 0.25 + 5, -3 - 0.5 * 2 - 1 / 8 + 0.75 * 4])
    # from 80 to 130 us slot 1 starts, from 160 to 310 slots 2 and 3, from 340 to the end none
    np.testing.assert_allclose(pairs.silent_start, [0.55, 1.35], rtol=1e-6)
    np.testing.assert_allclose(pairs.silent_end, [1.3 - 0.25, 3.1 - 0.25], rtol=1e-6)
    np.testing.assert_allclose(pairs.silent_bias, [0, -1 / 8])
    np.testing.assert_array_equal(pairs.probe_offset, [0, 1, 3])
    np.testing.assert_allclose(pairs.silent_probe, [0.75, 1.75, 2.75], rtol=1e-6)


@pytest.mark.parametrize("crossfade", [0.0, 0.3, 1.0])
def test_the_pair_law_holds_for_what_lagging_pixels_show(crossfade, rng):
    """Events simulated behind photoreceptors: between the phases told the light changes by the threshold."""
    light = 0.1 + rng.random((6, 8))  # of each pixel with each LED
    pixel = EventPixel(
        0.2, 0.3, event_noise=0.0, refractory_us=REFRACTORY_US, **NO_FLAWS | {"cutoff_hz": CUTOFF_HZ}
    )
    schedule = ring(range(8), SLOT_US, crossfade)
    signal = (light - 0.05).T.reshape(8, 2, 3)
    events, on, off, starts = simulate_events(signal, 0.05, schedule, 5, pixel)
    recording = Recording(events, Sensor(3, 2, on, off, REFRACTORY_US), schedule, starts)
    rows, refractory = np.arange(6, dtype=np.int32), REFRACTORY_US / SLOT_US
    receptors = Photoreceptors(light, rows, crossfade, TAU_SLOTS, refractory=refractory)

    def log_light(phase, pixel):
        slot, fade = np.divmod(phase.astype(float), 1)
        slot = slot.astype(int)
        return np.log((1 - fade) * light[pixel, slot] + fade * light[pixel, (slot + 1) % 8])

    def misfit(receptors):
        pairs = pair_events(recording, None, receptors)
        pixel = np.repeat(np.arange(6), np.diff(pairs.offset.astype(int)))
        change = log_light(pairs.phase_end, pixel) - log_light(pairs.phase_start, pixel)
        silent = np.repeat(np.arange(6), np.diff(pairs.probe_offset[pairs.silent_offset].astype(int)))
        start = np.repeat(pairs.silent_start, np.diff(pairs.probe_offset.astype(int)))
        quiet = log_light(pairs.silent_probe, silent) - log_light(start, silent)
        assert len(change) > 150 and len(quiet) > 50
        threshold = np.where(pairs.polarity > 0, 0.2, 0.3)
        return np.abs(pairs.polarity * change - threshold), np.maximum(quiet / 0.2, -quiet / 0.3)

    (told, quiet), (late, _) = misfit(receptors), misfit(None)
    assert np.quantile(told, 0.95) < 0.01 and np.median(told) < 0.1 * np.median(late)
    assert np.quantile(quiet, 0.98) < 1.02
