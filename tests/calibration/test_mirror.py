"""LED directions from the highlights of a mirror ball."""

import numpy as np
import pytest

from evsdr.calibration.mirror import find_highlights, led_contrast, reflect
from evsdr.errors import InputError
from evsdr.events.pixel import EventPixel
from evsdr.events.simulator import simulate_events
from evsdr.metrics import angular_error_deg
from evsdr.model.view import pixel_centers
from evsdr.records import Recording, Schedule, Sensor
from tests.support.balls import LIGHT, SIZE, average, camera, moved_directions


@pytest.mark.parametrize("perspective", [False, True])
def test_highlights_of_a_mirror_ball(rng, perspective):
    """Blobs of a finite LED, mirrored by brute force: each pixel looks for the LED that it reflects."""
    size, fine = 6 * SIZE, 2
    view, truth = camera(size, perspective), moved_directions(rng)
    outline = np.array([size / 2 + 0.4, size / 2 - 0.7, 0.8 * size / 2])
    pixel = pixel_centers(np.ones((size * fine, size * fine), bool)) / fine
    on_ball = np.linalg.norm(pixel - outline[:2], axis=1) < outline[2] * 0.99
    cosine = truth @ reflect(view, pixel, outline).T
    signal = np.exp((cosine - 1) / np.radians(2.0) ** 2) * on_ball
    signal = average(signal.reshape(24, size * fine, size * fine), fine)
    order = [k for j in range(24) for k in (j, -1)]  # each LED from darkness
    schedule = Schedule(np.array(order, np.int32), 5000.0, 1.0)
    events, on, off, starts = simulate_events(20 * signal, LIGHT, schedule, 1, EventPixel())
    recording = Recording(events, Sensor(size, size, on, off, 52.0), schedule, starts)
    found = find_highlights(view, led_contrast(recording, 24), outline, 0.0)
    error = angular_error_deg(found.direction, truth)
    assert error.max() < 0.6 and error.mean() < 0.3
    assert 0.5 < np.sqrt(np.mean((error / found.sigma_deg) ** 2)) < 1.5
    with pytest.raises(InputError, match="LED 3 leaves no highlight"):
        count = led_contrast(recording, 24)
        count[3] = 0
        find_highlights(view, count, outline, 0.1)


def test_reflection_by_hand():
    """Seen from above, the middle shows the camera, and n at 22.5 degrees shows a light at 45 degrees."""
    view = camera(200)
    outline = np.array([100.0, 100.0, 80.0])
    shift = 80 * np.sin(np.radians(22.5))
    shown = reflect(view, np.array([[100.0, 100.0], [100 + shift, 100], [100, 100 - shift]]), outline)
    half = np.sqrt(0.5)
    np.testing.assert_allclose(shown, [[0, 0, 1], [half, 0, half], [0, half, half]], atol=1e-12)
