"""What a fit says of thresholds, bands, scale, and pixels that contradict it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from evsdr.effects.effect import Decision
from evsdr.errors import InputWarning
from evsdr.fitting import report
from evsdr.fitting.settings import Settings
from evsdr.records import Schedule, Sensor

N = 100


def fitted(gain=None, noise=0.1, noisy=0):
    """A fit of 10 x 10 pixels; the first of them are so noisy that they count for nothing."""
    factor = np.ones(N)
    factor[:noisy] = 2 * report.CONTRARY
    solution = SimpleNamespace(
        noise=noise,
        noise_factor=factor,
        threshold_gain=gain,
        threshold_gain_sigma=None if gain is None else np.full((N, 2), 0.02),
        prior_scale={"rank": 3},
    )
    maps = SimpleNamespace(mask=np.ones((10, 10), bool))
    return SimpleNamespace(
        solution=solution, maps=maps, problem=SimpleNamespace(pixel=np.arange(N), n_pixel=N)
    )


def world(constant_light=0.05, busy=0):
    """A world whose first pixels fire nine times as often."""
    count = np.full(N, 20)
    count[:busy] *= 9
    recording = SimpleNamespace(
        source="b.h5", sensor=Sensor(10, 10, 0.2, 0.3, 50.0), schedule=Schedule(np.array([0, 0, 2]), 1e4, 1.0)
    )
    leds = SimpleNamespace(band=[0, 1, 2], band_wavelength_nm=np.array([450.0, 550.0, 650.0]))
    ring = SimpleNamespace(path="a.xml", constant_light=constant_light, leds=leds)
    pairs = SimpleNamespace(offset=np.append(0, np.cumsum(count)).astype(np.uint32))
    return SimpleNamespace(ring=ring, recording=recording, hot=None, pairs=lambda: pairs, decisions={})


def test_nothing_to_warn_of():
    report.warn_of_what_was_found(world(), fitted(np.ones((N, 2)), noisy=4))


@pytest.mark.parametrize(
    ("given", "fit", "words"),
    [
        ({"constant_light": 0}, {}, "^a.xml: constant_light is 0"),
        ({}, {"noise": 0.6}, "^b.h5: the events contradict a.xml, their thresholds scatter by 60%"),
        ({}, {"noisy": 7}, "^b.h5: 7% of the pixels fire .*gloss, a shadow"),
        ({"busy": 7}, {"noisy": 7}, "^b.h5: 7% of the pixels fire .*probably hot"),
        ({}, {"gain": np.full((N, 2), [1.0, 1.2])}, "contrast_threshold_off is told as 0.3 .* say 0.36"),
    ],
)
def test_what_a_user_should_look_into(given, fit, words):
    with pytest.warns(InputWarning, match=words):
        report.warn_of_what_was_found(world(**given), fitted(**fit))


def test_what_is_modelled_may_warn():
    doubt = Decision("clock", True, "", warning="events are late.")
    given = SimpleNamespace(**vars(world()) | {"decisions": {"clock": doubt}})
    with pytest.warns(InputWarning, match="^b.h5: events are late.$"):
        report.warn_of_what_was_found(given, fitted())
    given.decisions["clock"] = replace(doubt, modelled=False)
    report.warn_of_what_was_found(given, fitted())


def test_hot_pixels_are_counted_with_those_that_contradict():
    hot = np.zeros((10, 10), bool)
    hot[0, 5:8] = True
    with pytest.warns(InputWarning, match="8% of the pixels"):
        report.warn_of_what_was_found(SimpleNamespace(**vars(world()) | {"hot": hot}), fitted(noisy=6))


def test_thresholds_are_told_with_their_scatter(rng):
    gain = 1.1 + 0.05 * rng.standard_normal((N, 2))
    on = report.threshold_summary(world().recording, fitted(gain))["contrast_threshold_on"]
    assert on["told"] == 0.2 and on["found"] == pytest.approx(0.22, rel=0.02)
    assert on["spread_over_pixels"] == pytest.approx(0.2 * 0.05, rel=0.3)
    assert on["sigma_of_a_pixel"] == pytest.approx(0.22 * 0.02, rel=0.05)
    assert report.threshold_summary(world().recording, fitted()) == {}


def test_notes_on_the_model():
    notes = report.model_notes(world(), Settings(), fitted().solution)
    assert notes["bands"].startswith("2 of 3: order lights no LED of 550 nm")
    assert notes["scale"] == "absolute, by the constant light of 0.05"
    assert notes["neighbours"] == "spectra vary visibly in 3 directions"
    alone = report.model_notes(world(constant_light=0), Settings(priors=()), fitted().solution)
    assert alone["neighbours"].startswith("each pixel alone") and alone["scale"].startswith("unknown")
    adam = report.model_notes(world(), Settings(solver="adam"), fitted().solution)
    assert adam["silence"].startswith("not used")


def test_a_ring_that_was_put_right_and_still_does_not_fit_contradicts():
    mended = {"wiring": SimpleNamespace(modelled=True)}
    with pytest.warns(InputWarning, match="the events contradict"):
        report.warn_of_what_was_found(
            SimpleNamespace(**vars(world()) | {"decisions": mended}), fitted(noise=0.3)
        )
