"""Cast shadows are traced where they fall on the object, and as `--shadows` asks."""

from dataclasses import replace
from types import SimpleNamespace

import drjit as dr
import numpy as np
import pytest

from evsdr.effects.effect import Decision
from evsdr.effects.shadows import EXPLAINED, Shadows, ShadowsInEvents, ShadowsOnFit, ShadowsOrGloss
from evsdr.effects.world import Fitted, World
from evsdr.light.scene import load_scene
from evsdr.records import Maps
from evsdr.solve.visibility import Seen
from tests.conftest import REPOSITORY
from tests.support.worlds import load, with_ball, world_of


@pytest.mark.parametrize(("distance", "traced"), [(0.7, True), (9.0, False)])
def test_auto_traces_shadows_that_fall_on_the_object(tmp_path, distance, traced):
    world = world_of(load(tmp_path, with_ball(distance)))
    decision = Shadows().decide("auto", world, None)
    assert decision.modelled == traced == (decision.expected_deg > world.terms.limit_deg)
    assert (decision.found["blocked"] > 0) == traced
    begins = "traced on the scene's geometry: " if traced else "not modelled: no (pixel, LED)"
    assert decision.why.startswith(begins)


@pytest.mark.parametrize("distance", [0.7, 9.0])
def test_latent_starts_from_what_auto_traces(tmp_path, distance):
    world = world_of(load(tmp_path, with_ball(distance)))
    auto, latent = (Shadows().decide(asked, world, None) for asked in ("auto", "latent"))
    assert latent == auto


def test_another_limit_decides_otherwise(tmp_path):
    world = world_of(load(tmp_path, with_ball(0.7)), limit_deg=30.0)
    decision = Shadows().decide("auto", world, None)
    assert not decision.modelled and "less than 30" in decision.why


def test_auto_traces_nothing_on_a_sphere():
    world = world_of(load_scene(REPOSITORY / "scenes" / "sphere.xml", {"size": "32"}))
    decision = Shadows().decide("auto", world, None)
    assert not decision.modelled and decision.expected_deg == 0
    assert all(dr.width(e) == 1 for e in world.illumination().irradiance)


def test_modelled_shadows_are_in_the_light(tmp_path):
    world = world_of(load(tmp_path, with_ball(0.7)))
    shadowed = Shadows().model(world, None).illumination()
    assert min(float(dr.min(e)[0]) for e in shadowed.irradiance) == 0
    assert min(float(dr.min(e)[0]) for e in world.illumination().irradiance) > 0


@pytest.mark.parametrize("asked", ["off", "scene", "estimate", "downweight"])
def test_what_is_asked_for_is_done(tmp_path, asked):
    decision = Shadows().decide(asked, world_of(load(tmp_path, with_ball(9))), None)
    assert decision.modelled == (asked == "scene") and decision.why.endswith(f"--shadows {asked}")


def test_a_known_shape_casts_no_estimated_shadow(tmp_path):
    world = world_of(load(tmp_path, with_ball(0.7)))
    assert ShadowsOnFit().decide("auto", world, None) is None
    assert ShadowsOnFit().decide("off", world, None) is None


# ---------------------------------------------------------------------- what the events tell


@pytest.fixture
def heard(tmp_path, monkeypatch):
    """A world in which the first five LEDs are hidden from some pixels, by so much of the misfit explained."""
    world = world_of(load(tmp_path, with_ball(9.0)))
    pixel = np.flatnonzero(world.mask)
    share = np.ones((world.ring.leds.n_led, len(pixel)), np.float32)

    def hear(n_pixel, explained):
        share[:5, :n_pixel] = 0
        gain = np.where(np.arange(len(pixel)) < n_pixel, 50.0, 0.0)
        seen = Seen(share, np.zeros((len(pixel), 10)), gain < 0, gain, explained)
        monkeypatch.setattr(World, "seen", lambda self, fitted: seen)
        normal = np.broadcast_to(np.float32([0, 0, 1]), (*world.mask.shape, 3))
        grey = np.full((*world.mask.shape, world.ring.leds.n_band), 0.5, np.float32)
        nothing = np.zeros(world.mask.shape, np.float32)
        maps = Maps(normal, grey, world.mask, nothing, nothing, np.zeros(1))
        problem, solution = SimpleNamespace(pixel=pixel), SimpleNamespace(noise=0.05)
        return world, Fitted(problem, solution, maps)

    return hear


def test_hidden_leds_are_modelled_where_they_explain_the_misfit(heard):
    decision = ShadowsInEvents().decide("auto", *heard(300, EXPLAINED + 0.1))
    assert decision.modelled and decision.expected_deg > 0.05 and decision.found["pixels"] == 300
    assert decision.why.startswith("found: ") and "in 300 pixels" in decision.why
    assert decision.answer.share[:5, :300].max() == 0


def test_misfit_of_another_cause_hides_no_led(heard):
    world, fitted = heard(300, EXPLAINED - 0.1)
    decision = ShadowsInEvents().decide("auto", world, fitted)
    assert not decision.modelled and decision.why.endswith("but it explains only 25% of what is wrong there")
    assert ShadowsInEvents().decide("latent", world, fitted).modelled


def test_few_hidden_leds_do_not_count(heard):
    world, fitted = heard(1, 0.9)
    decision = ShadowsInEvents().decide(
        "auto", replace(world, terms=replace(world.terms, limit_deg=1.0)), fitted
    )
    assert not decision.modelled and "less than 1" in decision.why


def test_what_is_traced_stays_if_the_events_add_nothing(heard):
    world, fitted = heard(0, 0.0)
    assert ShadowsInEvents().decide("auto", world, fitted).why == "not modelled: the events show none"
    for modelled in (True, False):
        before = {"cast shadows": Decision("cast shadows", modelled, "before")}
        assert ShadowsInEvents().decide("auto", replace(world, decisions=before), fitted) is None


def test_a_model_that_all_pixels_contradict_is_not_mended_by_shadows(heard):
    """As with LEDs in a wrong order: the warning of that must not go away."""
    world, fitted = heard(300, 0.9)
    wrong = replace(fitted, solution=SimpleNamespace(noise=0.6))
    decision = ShadowsInEvents().decide("auto", world, wrong)
    assert not decision.modelled and decision.why == "not modelled: events and model contradict each other"


@pytest.mark.parametrize("asked", ["off", "scene", "estimate", "downweight"])
def test_events_are_not_asked_for_shadows_if_users_say_how(heard, asked):
    assert ShadowsInEvents().decide(asked, *heard(300, 0.9)) is None


def test_hidden_leds_are_dark_in_the_light(heard):
    world, fitted = heard(300, 0.9)
    light = ShadowsInEvents().model(world).illumination(fitted)
    first, last = (light.irradiance[j].numpy()[np.flatnonzero(world.mask)] for j in (0, -1))
    assert (first[:300] == 0).all() and (first[300:] > 0).all() and (last > 0).all()


def test_the_published_solver_says_that_it_finds_none(heard):
    world, fitted = heard(300, 0.9)
    decision = ShadowsInEvents().decide(
        "auto", replace(world, terms=replace(world.terms, solver="adam")), fitted
    )
    assert not decision.modelled and decision.why == "not modelled: the solver adam asks no events for them"


def test_shadows_that_were_gloss_are_counted(heard):
    """In one sentence, however often; once none is left, none is modelled."""
    world, fitted = heard(300, 0.9)
    found = Decision("cast shadows", True, "found: some", found={"pixels": 500})
    glossy = replace(world, shadows="latent", gloss=object(), decisions={"cast shadows": found})

    def ask(world, n_before, n_now):
        share = world.seen(fitted).share
        share[:5] = np.arange(share.shape[1]) >= n_now
        before = np.where(np.arange(share.shape[1]) < n_before, np.float32(0), np.ones_like(share))
        return ShadowsOrGloss().decide(
            "auto", world, replace(fitted, problem=SimpleNamespace(visible=before))
        )

    assert ask(replace(glossy, gloss=None), 500, 300) is None and ask(glossy, 300, 300) is None
    assert ask(replace(glossy, shadows="scene"), 500, 300) is None
    some = ask(glossy, 500, 300)
    assert some.modelled and some.why == "found: some; then found to be gloss in 200 pixels"
    none = ask(replace(glossy, decisions={"cast shadows": some}), 300, 0)
    assert not none.modelled and none.why == "found: some; then found to be gloss in 500 pixels"
    assert none.found == {"pixels": 500, "gloss": 500} and ShadowsOrGloss().model(glossy, none) is glossy
