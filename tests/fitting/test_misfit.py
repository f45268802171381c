"""Where a fit explains the events less well than elsewhere."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

import evsdr
from evsdr.fitting.misfit import in_words, least_of, places
from evsdr.solve.noise import Slotted

N_PIXEL, N_LED, N_ROUND = 144, 4, 6
MASK = np.ones((12, 12), bool)
SLOT_LEDS = np.array([j + 65536 * ((j + 1) % N_LED) for j in [*range(N_LED), 0]])


def slots(rng, wrong=lambda row, column, led, light: 0.0, noise=0.1):
    """Events of all pixels, one in each slot of each round, whose residuals are off by something in some."""
    pixel, _, led = (a.ravel() for a in np.mgrid[:N_PIXEL, :N_ROUND, :N_LED])
    light = rng.uniform(0.5, 1, (N_PIXEL, N_LED))[pixel, led]
    off = wrong(*np.divmod(pixel, 12), led, light)
    score = noise * rng.normal(size=len(pixel)) + off
    span = np.where(pixel >= 132, 0.9, rng.uniform(0.2, 0.3, len(pixel)))
    return Slotted(pixel, 2 * led, score, led + 0.4 - span, led + 0.4, light, (N_PIXEL, 2 * N_LED))


def said(pairs):
    return in_words(pairs, places(pairs, SLOT_LEDS, N_LED, MASK), 0.1)


def test_noise_is_the_same_everywhere(rng):
    for _ in range(5):
        assert said(slots(rng)).endswith("much alike everywhere")


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (lambda row, column, led, light: 0.1 * (led == 2), "larger while LED 2 is lit (0.098)"),
        (
            lambda row, column, led, light: 0.1 * ((row < 4) & (column > 7)),
            "larger in the top right of the object (0.1)",
        ),
        (lambda row, column, led, light: 0.1 * (light < 0.55), "larger in the dark (0.088)"),
        (lambda row, column, led, light: 0.1 * (row == 11), "where light is slow"),
        (lambda row, column, led, light: 0.1 * (light > 0.97), "in highlights"),
    ],
)
def test_places_are_named(rng, wrong, words):
    assert words in said(slots(rng, wrong))


def test_noise_does_not_come_again_and_what_does_is_measured(rng):
    assert least_of(slots(rng, noise=0.3)) < 0.03
    assert 0.08 < least_of(slots(rng, lambda row, column, led, light: 0.1)) <= 0.11


def test_few_events_tell_nothing(rng):
    few = slots(rng)
    lists = "pixel", "group", "score", "start", "end", "light"
    few = replace(few, **{name: getattr(few, name)[:20] for name in lists})
    assert said(few) == "too few events to tell"
    assert least_of(few) == 0
    none = Slotted(*np.zeros((2, 0), int), *np.zeros((4, 0)), (N_PIXEL, 2 * N_LED))
    assert in_words(none, places(none, SLOT_LEDS, N_LED, MASK), 0.1) == "too few events to tell"


def test_a_fit_says_it():
    scene = evsdr.load_scene("scenes/sphere.xml", size=12)
    recording, _ = evsdr.simulate(scene, evsdr.EventPixel(event_noise=0.1).idealised(), rounds=3)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", evsdr.InputWarning)  # thresholds of so few events
        found = evsdr.fit(scene, recording, evsdr.Settings(preset="fast", shared=()))
    assert found.summary["misfit"].startswith("residuals that come again in every round are 0")
