"""What calibrations of LEDs share: the recording, its counts, the light that the scene tells."""

import numpy as np
import pytest

from evsdr.calibration.ring_recording import count_events, nominal_light, read_ring_events
from evsdr.errors import InputError
from evsdr.events.pixel import EventPixel
from evsdr.events.record import record, ring_schedule
from evsdr.files.events_h5 import write_recording
from evsdr.light.scene import load_scene
from tests.support.analytic import ring_directions
from tests.support.small_scene import HEIGHT, WIDTH, leds, scene


@pytest.fixture
def ring(tmp_path):
    (tmp_path / "scene.xml").write_text(scene())
    return load_scene(tmp_path / "scene.xml")


def recorded(path, order=None, trim=None):
    signal = np.zeros((8, HEIGHT, WIDTH))
    signal[::2, 3, 5] = 1.0
    recording = record(signal, 0.1, EventPixel.ideal(), ring_schedule(8, order, trim=trim), 1)
    write_recording(path, recording)
    return recording


def test_each_led_must_be_lit(ring, tmp_path):
    recorded(tmp_path / "all.h5")
    assert len(read_ring_events(tmp_path / "all.h5", ring).events)
    recorded(tmp_path / "dark.h5", trim=[1, 0, *[0.5] * 6])
    with pytest.raises(InputError, match="schedule/order lights 7 LEDs"):
        read_ring_events(tmp_path / "dark.h5", ring)
    recorded(tmp_path / "some.h5", (0, 1, 2, -1))
    with pytest.raises(InputError, match=r"some.h5: schedule/order lights 3 LEDs but .*scene.xml has 8"):
        read_ring_events(tmp_path / "some.h5", ring)


def test_events_are_counted_where_they_are(tmp_path):
    recording = recorded(tmp_path / "a.h5")
    count = count_events(recording)
    assert count.shape == (HEIGHT, WIDTH) and count[3, 5] == count.sum() == len(recording.events)


def test_far_leds_have_one_direction_and_near_ones_one_per_pixel(ring, tmp_path):
    light = nominal_light(ring)
    assert not light.near
    np.testing.assert_allclose(light.direction[:, 0], ring_directions(8), atol=1e-5)
    np.testing.assert_allclose(light.mean_direction, ring_directions(8), atol=1e-5)
    np.testing.assert_allclose(light.gain, 1, rtol=1e-5)
    (tmp_path / "near.xml").write_text(scene(light=leds(distance=4.0)))
    light = nominal_light(load_scene(tmp_path / "near.xml"))
    n = light.mask.sum()
    assert light.near and light.direction.shape == (8, n, 3) and light.gain.shape == (8, n)
    for direction in (light.direction, light.mean_direction):
        np.testing.assert_allclose(np.linalg.norm(direction, axis=-1), 1, atol=1e-5)
    assert np.ptp(light.gain, axis=1).min() > 0.01
