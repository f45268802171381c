"""What a fit says of thresholds, bands and scale."""

import pytest

from evsdr.fitting import report
from evsdr.fitting.settings import Settings
from tests.support.told_fits import N, fitted, world


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
