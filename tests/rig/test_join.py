"""Events and the ring's log become a recording; what is known of the sensor goes with it."""

import h5py
import numpy as np
import pytest

from evsdr.errors import InputError, InputWarning
from evsdr.files.events_h5 import SENSOR_DEFAULTS, read_recording
from evsdr.rig.join import join, read_sensor, write_joined
from evsdr.rig.log import parse_ring_log
from tests.support.camera_files import make_recording
from tests.support.ring_log import LOG, N_ROUND, ORDER, ROUND_US, SLOT_US, STARTS, pulses


@pytest.fixture
def camera(rng):
    t = np.sort(rng.choice(70_000, 4000, replace=False))
    x, y, p = rng.integers(0, 64, 4000), rng.integers(0, 48, 4000), rng.integers(0, 2, 4000)
    edges = pulses(STARTS)
    return make_recording(x, y, p, t, edges.p, edges.t, edges.id)


def test_events_of_the_rounds_stay(camera):
    recording, rounds = join(camera, parse_ring_log(LOG), {"refractory_us": 30.0})
    t = camera.events.t
    np.testing.assert_array_equal(recording.events.t, t[(t >= STARTS[0]) & (t < STARTS[-1])])
    np.testing.assert_array_equal(recording.round_start_us, STARTS)
    assert len(rounds) == N_ROUND
    assert recording.schedule.order.tolist() == ORDER
    assert recording.schedule.trim.tolist() == [1.0] * 24 and recording.schedule.constant_light_on is True
    assert recording.sensor.refractory_us == 30
    assert recording.sensor.contrast_threshold_on == SENSOR_DEFAULTS["contrast_threshold_on"]


def test_a_lamp_of_ones_own_is_not_the_rings(camera):
    recording, _ = join(camera, parse_ring_log(LOG), {}, lamp="own")
    assert recording.schedule.constant_light_on is None


def test_a_clock_that_runs_fast_stretches_the_slots(camera):
    recording, rounds = join(camera, parse_ring_log(LOG | {"slot_us": SLOT_US / 1.004}), {})
    assert recording.schedule.slot_us == pytest.approx(SLOT_US)
    assert rounds.clock_ratio == pytest.approx(1.004, rel=1e-4)


def test_a_start_by_hand_needs_no_triggers(camera):
    recording, rounds = join(camera, parse_ring_log(LOG), {}, start_us=5000.0)
    assert rounds is None and len(recording.round_start_us) == 0
    assert recording.schedule.start_us == 5000
    inside = (camera.events.t >= 5000) & (camera.events.t < 5000 + N_ROUND * ROUND_US)
    assert len(recording.events) == inside.sum()
    with pytest.raises(InputError, match="--start-us is not a finite number"):
        join(camera, parse_ring_log(LOG), {}, start_us=float("nan"))
    with pytest.raises(InputError, match="0 events lie within the rounds"):
        join(camera, parse_ring_log(LOG), {}, start_us=1e6)


def test_values_by_hand_win_over_the_file(tmp_path):
    np.savez(tmp_path / "c.npz", contrast_threshold_on=0.3, refractory_us=40.0)
    known = read_sensor((4, 6), thresholds=tmp_path / "c.npz", threshold_on=0.2, threshold_off=0.5)
    assert known == {"contrast_threshold_on": 0.2, "contrast_threshold_off": 0.5, "refractory_us": 40.0}
    assert read_sensor((4, 6)) == {}
    with pytest.raises(InputError, match="--refractory-us is -1; give the true value"):
        read_sensor((4, 6), refractory_us=-1.0)


def test_thresholds_of_the_whole_sensor_are_cropped(tmp_path, rng):
    on = rng.uniform(0.2, 0.3, (4, 6)).astype(np.float32)
    np.savez(tmp_path / "c.npz", contrast_threshold_on=on)
    known = read_sensor((4, 6), (1, 2, 3, 2), tmp_path / "c.npz")
    np.testing.assert_array_equal(known["contrast_threshold_on"], on[2:4, 1:4])
    with pytest.raises(InputError, match=r"must be a number or an array of \(height, width\) = \(5, 6\)"):
        read_sensor((5, 6), thresholds=tmp_path / "c.npz")


def test_what_is_not_known_is_not_written(tmp_path, camera):
    known = {"contrast_threshold_on": 0.3}
    recording, _ = join(camera, parse_ring_log(LOG), known)
    write_joined(tmp_path / "events.h5", recording, known)
    with h5py.File(tmp_path / "events.h5") as file:
        assert set(file["sensor"].attrs) == set(known)
    with pytest.warns(InputWarning, match="sensor lacks contrast_threshold_off .*, refractory_us"):
        assert read_recording(tmp_path / "events.h5").sensor.contrast_threshold_on == pytest.approx(0.3)
