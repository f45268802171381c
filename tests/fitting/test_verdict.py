"""Whether a fit can be trusted, and what its user should look into."""

from dataclasses import replace

import numpy as np
import pytest

from evsdr.effects.effect import Decision
from evsdr.effects.leds import LedPowers
from evsdr.errors import InputWarning
from evsdr.fitting.verdict import TRUSTWORTHY, Verdict, judge
from tests.support.shared_worlds import decision as shared_decision
from tests.support.told_fits import N, fitted, world

ERROR = Decision("set-up", False, "", None, {"remedy": "mirror it"}, "the image is mirrored: look")
MENDED = Decision("wiring", True, "", warning="LED 5 gives no light.")


def said(match, *given):
    """Judge, see that the user is warned of it, and give the verdict."""
    with pytest.warns(InputWarning, match=match):
        return str(judge(*given))


def test_nothing_to_warn_of():
    assert str(judge(world(), fitted(np.ones((N, 2)), noisy=4))) == TRUSTWORTHY


def test_an_unknown_scale_is_told_but_no_doubt():
    assert said("^a.xml: constant_light is 0", world(constant_light=0), fitted(scaled=0)) == TRUSTWORTHY


@pytest.mark.parametrize(
    ("given", "fit", "words"),
    [
        ({}, {"noisy": 7}, "^b.h5: 7% of the pixels fire .*gloss, a shadow"),
        ({}, {"noisy": 7, "busy": 7}, "^b.h5: 7% of the pixels fire .*probably hot"),
        ({}, {"gain": np.full((N, 2), [1.0, 1.2])}, "contrast_threshold_off is told as 0.3 .* say 0.36"),
        ({}, {"known": 0}, "^b.h5: no pixel is known"),
        ({}, {"known": 40}, "^b.h5: only 40% of the pixels that fire are known"),
        ({}, {"scaled": 75}, "^b.h5: 25% of the known pixels can't tell their scale.*: put a dark slot"),
        ({"decisions": {"wiring": MENDED}}, {}, "^b.h5: LED 5 gives no light.$"),
    ],
)
def test_what_a_user_should_look_into(given, fit, words):
    assert said(words, world(**given), fitted(**fit)).startswith("doubtful: b.h5: ")


def test_a_constant_light_that_is_too_weak_is_a_doubt():
    weak = said("^a.xml: constant_light is 0.002 of the light", world(constant_light=1e-3), fitted())
    assert weak.startswith("doubtful: a.xml: ")
    assert str(judge(world(constant_light=0.01), fitted())) == TRUSTWORTHY


def test_surfaces_that_reflect_more_than_they_get_are_a_doubt():
    """By two sigmas, a tenth of the pixels whose scale is known, in any band; but not where no scale is told."""
    bright = np.full((10, 10, 3), 0.5)
    bright[8:, :, 2] = 1.5
    doubt = said("^a.xml: a tenth of the pixels reflect 1.5 times", world(), fitted(reflectance=bright))
    assert doubt.startswith("doubtful: a.xml: ")
    for seemly in (np.minimum(bright, 1.3), np.where(np.arange(300).reshape(10, 10, 3) < 275, 0.5, bright)):
        assert str(judge(world(), fitted(reflectance=seemly))) == TRUSTWORTHY
    unscaled = said("can't tell their scale", world(), fitted(reflectance=bright, scaled=80))
    assert "reflect " not in unscaled
    dark = said("constant_light is 0", world(constant_light=0), fitted(reflectance=bright))
    assert dark == TRUSTWORTHY


def test_a_fit_that_was_stopped_is_doubtful():
    assert said("stopped early", world(), fitted(), True).startswith(
        "doubtful: b.h5: this fit was stopped early"
    )


def test_residuals_that_come_again_in_every_round_are_a_doubt():
    again = said("^b.h5: residuals of 0.07 of a threshold come again", world(), fitted(), False, 0.07)
    assert again.startswith("doubtful: b.h5: ")
    assert str(judge(world(), fitted(), recurring=0.03)) == TRUSTWORTHY


def test_photoreceptors_that_no_fit_follows_are_a_doubt():
    again = said(
        "^b.h5: photoreceptors are so slow .* by 0.4 of their noise", world(), fitted(), False, 0.0, 0.4
    )
    assert again.startswith("doubtful: b.h5: ")
    assert str(judge(world(), fitted(), moved=0.2)) == TRUSTWORTHY


def test_shadows_that_only_events_tell_are_a_doubt_where_most_pixels_lie_in_them():
    words = "^b.h5: 60% of the known pixels lie in the shadow of some LEDs"
    given = world(shadows="latent")
    assert said(words, given, fitted(hidden=60)).startswith("doubtful: b.h5: ")
    assert said("75% of the known pixels", given, fitted(hidden=60, known=80)).startswith("doubtful")
    assert str(judge(given, fitted(hidden=40))) == str(judge(given, fitted())) == TRUSTWORTHY
    assert str(judge(world(shadows="latent", shape=True), fitted(hidden=60))) == TRUSTWORTHY
    assert str(judge(world(shadows="scene"), fitted(hidden=60))) == TRUSTWORTHY


def test_what_is_not_modelled_does_not_warn():
    given = world(decisions={"wiring": replace(MENDED, modelled=False)})
    assert str(judge(given, fitted())) == TRUSTWORTHY


def test_hot_pixels_are_counted_with_those_that_contradict():
    hot = np.zeros((10, 10), bool)
    hot[0, 5:8] = True
    assert said("8% of the pixels", world(hot=hot), fitted(noisy=6)).startswith("doubtful")


def test_events_that_contradict():
    words = "^b.h5: the events contradict a.xml, their thresholds scatter by 60%"
    assert said(words, world(), fitted(noise=0.6)).startswith("contradicted: b.h5: the events contradict")


def test_a_ring_that_was_put_right_and_still_does_not_fit_contradicts():
    given = world(decisions={"wiring": MENDED})
    assert said("the events contradict", given, fitted(noise=0.3)).startswith("contradicted")
    assert said("gives no light", given, fitted(noise=0.2)).startswith("doubtful")


def test_a_set_up_that_another_one_explains():
    given = world(decisions={"set-up": ERROR})
    sentence = "b.h5: the image is mirrored: look; mirror it, or use --repair."
    assert said(sentence, given, fitted(noise=0.6, noisy=7)) == f"contradicted: {sentence}"
    repaired = replace(ERROR, modelled=True, warning="the image is mirrored; the fit took that for true.")
    assert said("took that for true", world(decisions={"set-up": repaired}), fitted()).startswith("doubtful")


def test_one_verdict():
    assert str(Verdict()) == "trustworthy"
    assert str(Verdict((), ("a.", "b."))) == "doubtful: a. b."
    assert str(Verdict(("c.",), ("a.",))) == "contradicted: c."


def test_thresholds_that_are_others_for_the_rig_than_for_the_maps_are_a_doubt():
    """By a tenth and more, beyond what chance makes, and not where lobes tell why."""
    found = shared_decision(LedPowers())  # 0.1 +- 0.01
    told, apart = world(decisions={"LED powers": found}), fitted(prior=(0.1, -0.1, 0.1, 0.1))
    assert said(
        "^b.h5: the mean contrast thresholds are 0% .on. and 22% .off. apart", told, apart
    ).startswith("doubtful: b.h5: ")
    assert str(judge(told, fitted(prior=(0.15, 0.05, 0.1, 0.1)))) == TRUSTWORTHY
    assert str(judge(world(decisions={"LED powers": found}, gloss="lobes"), apart)) == TRUSTWORTHY
    sigma = replace(found.answer.inferred.sigma, log_threshold=np.full(2, 0.1))
    vague = replace(found.answer, inferred=replace(found.answer.inferred, sigma=sigma))
    assert str(judge(world(decisions={"a": replace(found, answer=vague)}), apart)) == TRUSTWORTHY
