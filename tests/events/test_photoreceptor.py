"""Photoreceptors in closed form against small steps of their equation."""

import numpy as np
import pytest

from evsdr.events.photoreceptor import Photoreceptors

N_SLOT, N_STEP = 7, 10_500  # steps per round, 1500 per slot
TAU = 0.01  # slots: slower than an EVK4 in slots of 20 ms


def light_at(position, light, crossfade):
    """Give I (n_pixel) at slot + fraction."""
    slot = int(position) % N_SLOT
    fade = max(position - int(position) - (1 - crossfade), 0) / crossfade if crossfade else 0
    return light[:, slot] + fade * (light[:, (slot + 1) % N_SLOT] - light[:, slot])


def stepped(light, crossfade, tau):
    """Give v (N_STEP, n_pixel) after each step of the third round."""
    dt = N_SLOT / N_STEP
    v, out = np.log(light[:, 0]), []
    for k in range(3 * N_STEP):
        now = light_at((k + 0.5) * dt, light, crossfade)
        v = np.log(now) + (v - np.log(now)) * np.exp(-dt * now / tau)
        out.append(v)
    return np.array(out[2 * N_STEP :])


@pytest.fixture
def light(rng):
    out = 0.05 + rng.random((6, N_SLOT)) ** 3
    out[0, 2:5] = 0.05  # dark slots
    out[1, 3] = out[1, 4]  # a slot of steady light
    return out


@pytest.mark.parametrize(
    "crossfade, tau",
    [(1.0, TAU), (0.3, TAU), (1.0, 10 * TAU), (0.02, TAU), (1e-9, TAU), (0.0, TAU), (0.0, 10 * TAU)],
)
def test_light_of_the_phase_is_what_is_shown(light, crossfade, tau):
    receptors = Photoreceptors.under(light, np.arange(6, dtype=np.int32), tau, crossfade)
    v = stepped(light, crossfade, tau)
    step = np.arange(50, N_STEP, 49)
    position = (step + 1) * N_SLOT / N_STEP
    worst, moved = 0, 0
    for pixel in range(6):
        phase = receptors.shown(position, np.full(len(step), pixel)).astype(float)
        slot, fade = phase.astype(int), phase % 1
        light_then = light[pixel, slot] + fade * (light[pixel, (slot + 1) % N_SLOT] - light[pixel, slot])
        worst = max(worst, np.abs(np.log(light_then) - v[step, pixel]).max())
        now = np.log([light_at(p, light, crossfade)[pixel] for p in position])
        moved = max(moved, np.abs(now - v[step, pixel]).max())
    assert moved > 0.2 and worst < 0.004


def test_fast_photoreceptors_show_the_light_of_now(light):
    receptors = Photoreceptors.under(light, np.arange(6, dtype=np.int32), 1e-7, 1.0)
    position = np.linspace(0.2, 6.9, 50)
    np.testing.assert_allclose(receptors.shown(position, np.full(50, 3)), position, atol=1e-3)


def test_the_moment_of_a_hard_switch_shows_the_light_before_it(light):
    receptors = Photoreceptors.under(light, np.arange(6, dtype=np.int32), 1e-4, 0.0)
    slot = np.repeat(np.arange(1, N_SLOT), 6)
    phase = receptors.shown(slot.astype(float), np.tile(np.arange(6), N_SLOT - 1)).astype(float)
    before, fade = phase.astype(int), phase % 1
    pixel = np.tile(np.arange(6), N_SLOT - 1)
    found = light[pixel, before] + fade * (light[pixel, (before + 1) % N_SLOT] - light[pixel, before])
    np.testing.assert_allclose(found, light[pixel, slot - 1], rtol=1e-6)


def test_noise_adds_to_what_is_shown():
    light = np.tile(0.1 * 2.0 ** np.arange(N_SLOT), (1, 1))
    receptors = Photoreceptors.under(light, np.zeros(1, np.int32), 1e-7, 1.0, noise=0.01)
    position = np.array([2.5, 2.5, 2.5])
    phase = receptors.shown(position, np.zeros(3, int), np.array([1.0, -1.0, 0.0])).astype(float)
    shown = np.log(light[0, 2] + (phase - 2) * (light[0, 3] - light[0, 2]))
    np.testing.assert_allclose(shown - shown[2], [0.01, -0.01, 0], atol=1e-4)


def test_noise_moves_no_phase_far_where_light_hardly_changes():
    light = 0.5 + 1e-3 * np.arange(N_SLOT)[None]
    receptors = Photoreceptors.under(light, np.zeros(1, np.int32), 1e-7, 1.0, noise=0.01)
    phase = receptors.shown(np.full(2, 2.5), np.zeros(2, int), np.array([1.0, -1.0]))
    np.testing.assert_allclose(phase, [2.58, 2.42], atol=1e-4)


def test_pixels_of_unknown_light_keep_their_phases(light):
    receptors = Photoreceptors.under(light, np.array([-1, 0], np.int32), TAU, 0.5)
    phase = receptors.shown(np.array([1.25, 1.75]), np.zeros(2, int))
    np.testing.assert_allclose(phase, [1.0, 1.5])
