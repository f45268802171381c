"""Photoreceptors of an image: what they show of events, and what their noise adds."""

import numpy as np
import pytest

from evsdr.events.lead import TABLE, kept, read_lead
from evsdr.events.photoreceptor import LEAST_ANSWER, MOST_ANSWER, Photoreceptors
from tests.support.receptor_steps import CROSSFADES, N_SLOT, TAU, light_of, stepped

N_PIXEL = 6
ROWS = np.arange(N_PIXEL, dtype=np.int32)


@pytest.fixture
def light(rng):
    out = 0.05 + rng.random((N_PIXEL, N_SLOT)) ** 3
    out[0, 2:5] = 0.05  # dark slots
    return out


def look(receptors, position, pixel=None, polarity=1.0):
    """Look at events at positions, all of one pixel, or of every pixel if none is named."""
    n = len(position)
    count = np.full(N_PIXEL, n) if pixel is None else n * (np.arange(N_PIXEL) == pixel)
    position = np.tile(position, count.sum() // n)
    return receptors.shown(
        np.append(0, np.cumsum(count)), position, np.broadcast_to(polarity, len(position)) * 1.0
    )


def log_light(phase, light):
    slot, fade = phase.astype(int), phase.astype(float) % 1
    return np.log(light[slot] + fade * (light[(slot + 1) % N_SLOT] - light[slot]))


@pytest.mark.parametrize("crossfade", CROSSFADES)
def test_the_light_of_the_phases_is_what_is_shown(light, crossfade):
    """When events fire, and a refractory period later, also into the next round."""
    steps = np.arange(50, 10_500, 49)
    refractory = 200 * N_SLOT / 10_500
    given = Photoreceptors(light, ROWS, crossfade, TAU, dark=0.1, refractory=refractory)
    found, late = look(given, (steps + 1) * N_SLOT / 10_500), 0.0
    for pixel in range(N_PIXEL):
        _, log_now, v = stepped(light[pixel], TAU, 0.1, crossfade)
        mine = slice(pixel * len(steps), (pixel + 1) * len(steps))
        for phases, k in ((found.fired, steps), (found.memorised, (steps + 200) % len(v))):
            np.testing.assert_allclose(log_light(phases[mine], light[pixel]), v[k], atol=0.005)
            late = max(late, np.abs(log_now[k] - v[k]).max())
    assert late > 0.15 and not found.ahead.any() and not found.left.any()


def test_fast_photoreceptors_show_the_light_of_now(light):
    receptors = Photoreceptors(light, ROWS, 1.0, 0.0)
    position = np.linspace(0.2, 6.9, 50)
    np.testing.assert_allclose(look(receptors, position, 3).fired, position, atol=1e-3)


def test_the_moment_of_a_hard_switch_shows_the_light_after_it_only_later(light):
    receptors = Photoreceptors(light, ROWS, 0.0, 0.1 * TAU)
    slot = np.arange(1.0, N_SLOT)
    v = log_light(look(receptors, slot + 1e-9, 3).fired, light[3])
    before = np.log([light_of(s - 0.5, light[3], 0.0) for s in slot])
    np.testing.assert_allclose(v, before, atol=1e-3)


def test_phases_where_slots_start_are_those_of_events(light):
    receptors = Photoreceptors(light, ROWS, 1.0, TAU, noise=0.02, refractory=0.1)
    slot = np.tile(np.arange(N_SLOT, dtype=float), 2)
    offset = np.append(0, np.cumsum(np.full(N_PIXEL, len(slot))))
    phases = receptors.phases(offset, np.tile(slot, N_PIXEL))
    np.testing.assert_array_equal(phases, look(receptors, slot).fired)


def test_noise_adds_its_lead_and_what_is_kept_of_it():
    """Light that grows evenly in its logarithm, so that the lag is one number."""
    growth, tau, noise, refractory = 0.7, 1e-3, 0.01, 0.001
    light = np.tile(0.1 * np.exp(growth * np.arange(N_SLOT)), (N_PIXEL, 1))
    receptors = Photoreceptors(light, ROWS, 1.0, tau, noise=noise, refractory=refractory)
    polarity = np.array([1.0, -1.0])
    found = look(receptors, np.array([3.5, 3.5]), 2, polarity)
    now = light_of(3.5, light[2], 1.0)
    late = (light[2, 4] - light[2, 3]) / now / (now / tau)
    lead, _, velocity = read_lead(TABLE, noise / late, 0.0)
    np.testing.assert_allclose(found.ahead, polarity * noise * lead, rtol=0.01)
    level, share = kept(refractory * now / tau, 0.0)
    np.testing.assert_allclose(found.left, polarity * noise * (level * lead + share * velocity), rtol=0.02)
    assert 0.2 * abs(found.ahead[0]) < abs(found.left[0]) < abs(found.ahead[0])


def test_pixels_of_unknown_light_keep_their_phases(light):
    receptors = Photoreceptors(light, np.full(N_PIXEL, -1, np.int32), 0.5, TAU, noise=0.01, refractory=0.4)
    found = look(receptors, np.array([1.25, 1.75]), 1)
    np.testing.assert_allclose(found.fired, [1.0, 1.5])
    np.testing.assert_allclose(found.memorised, [1.3, 2.0])
    assert not found.ahead.any() and not found.left.any()


@pytest.mark.parametrize("crossfade", CROSSFADES)
def test_answers_are_what_more_light_makes_of_what_is_shown(light, crossfade):
    """Against a receptor in small steps, under light that is 1 % stronger and weaker."""
    steps = np.arange(50, 10_500, 49)
    receptors = Photoreceptors(light, ROWS, crossfade, TAU, dark=0.1)
    found, away = look(receptors, (steps + 1) * N_SLOT / 10_500), 0.0
    for pixel in range(N_PIXEL):
        _, log_now, v = stepped(light[pixel], TAU, 0.1, crossfade)
        more, less = (stepped(factor * light[pixel], TAU, 0.1, crossfade)[2] for factor in (1.01, 1 / 1.01))
        expected = np.clip((more - less) / (2 * np.log(1.01)), LEAST_ANSWER, MOST_ANSWER)[steps]
        mine = slice(pixel * len(steps), (pixel + 1) * len(steps))
        np.testing.assert_allclose(found.answer[0, mine], expected, atol=0.02)
        np.testing.assert_allclose(found.log[0, mine], v[steps], atol=0.005)
        away = max(away, np.abs(expected - 1).max())
    assert away > 0.1
    fast = look(Photoreceptors(light, ROWS, crossfade, 0.0), (steps + 1) * N_SLOT / 10_500)
    np.testing.assert_allclose(fast.answer, 1, atol=1e-3)
