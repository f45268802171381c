"""Of a recording the solver gets the masked pixels, and of the hot ones no events."""

import mitsuba as mi
import numpy as np
import pytest

from evsdr.events.pairs import Pairs
from evsdr.model.illumination import Illumination
from evsdr.records import Events, Recording, Schedule, Sensor
from evsdr.solve.problem import DARK, make_problem

MASK = np.array([[1, 1, 0], [1, 0, 1]], bool)
COUNT, SILENT = np.array([2, 0, 4, 3, 1, 5]), np.array([1, 3, 2, 0, 2, 4])


@pytest.fixture
def recorded(rng):
    """A recording of six pixels, and its pairs, whose phases tell their own number."""
    start, silent = np.arange(COUNT.sum()) / 16, np.arange(SILENT.sum()) / 16
    pairs = Pairs(
        offset=np.append(0, np.cumsum(COUNT)).astype(np.uint32),
        phase_start=start.astype(np.float32),
        phase_end=(start + 0.5).astype(np.float32),
        polarity=rng.choice([-1, 1], len(start)).astype(np.int8),
        bias=start.astype(np.float32) - 0.5,
        answer=None,
        n_event=0,
        n_dropped=0,
        silent_offset=np.append(0, np.cumsum(SILENT)).astype(np.uint32),
        silent_start=silent.astype(np.float32),
        silent_end=(silent + 0.25).astype(np.float32),
        silent_polarity=rng.choice([-1, 0, 1], len(silent)).astype(np.int8),
        silent_bias=silent.astype(np.float32) - 0.25,
        probe_offset=3 * np.arange(len(silent) + 1, dtype=np.uint32),
        silent_probe=np.arange(3 * len(silent), dtype=np.float32) % 2,
    )
    on = rng.uniform(0.1, 0.3, MASK.shape).astype(np.float32)
    schedule = Schedule(np.array([1, -1], np.int32), 100.0, 1.0)
    nothing = Events(*np.zeros((4, 0), int))
    return Recording(nothing, Sensor(3, 2, on, 0.4, 50.0), schedule, np.empty(0, np.int64)), pairs


def light(rng, constant_light=0.05):
    irradiance = mi.Float(rng.random(6).astype(np.float32))
    return Illumination(
        [mi.Vector3f(0, 0, 1)] * 2, [irradiance, mi.Float(2.0)], [0, 1], mi.Float(constant_light)
    )


@pytest.mark.parametrize("hot", [None, 3])
def test_pairs_and_silences_of_the_masked_pixels(recorded, rng, hot):
    recording, pairs = recorded
    hot_map = None if hot is None else np.arange(6).reshape(MASK.shape) == hot
    problem = make_problem(recording, pairs, light(rng), MASK, hot_map)
    pixel = np.flatnonzero(MASK)
    np.testing.assert_array_equal(problem.pixel, pixel)
    np.testing.assert_array_equal(problem.fired, COUNT[pixel] > 0)
    ours = problem.pairs
    for name, count, polarity, length in (
        ("", COUNT, pairs.polarity, 0.5),
        ("silent_", SILENT, pairs.silent_polarity, 0.25),
    ):
        first, last, phases = (getattr(ours, f"{name}{of}").numpy() for of in ("first", "last", "phases"))
        bias = (ours.silent_bias if name else ours.bias).numpy()
        kept = np.repeat(MASK.ravel() & (np.arange(6) != hot), count)
        k = np.concatenate([np.arange(*ends) for ends in zip(first, last)])
        np.testing.assert_array_equal(k, np.flatnonzero(kept))
        start, coded = phases.reshape(-1, 2)[k].T
        np.testing.assert_allclose(start, k / 16)
        np.testing.assert_allclose(coded, polarity[k] * (1 + k / 16 + length))
        np.testing.assert_allclose(bias[k], k / 16 - length)
        np.testing.assert_array_equal(last - first, np.where(pixel == hot, 0, count[pixel]))
    probes = problem.pairs.silent_probes.numpy().reshape(-1, 2)[k]
    np.testing.assert_array_equal(probes, 3 * np.stack([k, k + 1], axis=-1))
    assert problem.told is pairs
    np.testing.assert_array_equal(problem.pairs.probes.numpy(), pairs.silent_probe)


def test_thresholds_and_light_of_the_masked_pixels(recorded, rng):
    """A threshold that is one number counts for all; light that is the same everywhere stays one number."""
    recording, pairs = recorded
    given = light(rng)
    problem = make_problem(recording, pairs, given, MASK)
    np.testing.assert_array_equal(
        problem.pairs.threshold_on.numpy(), recording.sensor.contrast_threshold_on[MASK]
    )
    np.testing.assert_array_equal(problem.pairs.threshold_off.numpy(), np.full(4, np.float32(0.4)))
    irradiance = [e.numpy() for e in problem.illumination.irradiance]
    np.testing.assert_array_equal(irradiance[0], given.irradiance[0].numpy()[MASK.ravel()])
    assert irradiance[1].tolist() == [2.0]
    assert float(problem.illumination.constant_light[0]) == np.float32(0.05)


def test_the_constant_light_is_above_0(recorded, rng):
    recording, pairs = recorded
    problem = make_problem(recording, pairs, light(rng, 0.0), MASK)
    assert float(problem.illumination.constant_light[0]) == pytest.approx(2.0 * DARK)
