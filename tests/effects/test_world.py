"""The world gives the problem to solve; what it knows already it does not work out again."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from evsdr.effects.gloss_fit import Gloss
from evsdr.effects.shared import Aim
from evsdr.effects.world import Fitted, World
from evsdr.errors import InputError
from evsdr.files.events_h5 import read_recording
from evsdr.model.gloss import GlossyRing, RoughCoating
from evsdr.model.lambert import LambertianRing
from evsdr.solve.visibility import Seen
from tests.support.small_scene import leds, scene
from tests.support.worlds import load, world_of


@pytest.fixture
def world(tmp_path):
    return world_of(load(tmp_path, scene(light=leds(distance=4))))


def test_light_is_traced_once(world):
    light = world.illumination()
    assert world.illumination() is light and replace(world, rays=world.rays).illumination() is light
    assert replace(world, rays=16).illumination() is not light
    assert replace(world, near=True).illumination() is not light
    assert world.trace(False, 4, seed=1) is not world.trace(False, 4)


def test_shadows_of_a_fit_need_a_fit(world):
    """Before there is one, light is that of the placeholder."""
    unknown = replace(world, shadows="estimate")
    assert unknown.on_fit and unknown.light_follows_fit and not world.light_follows_fit
    assert unknown.illumination() is world.illumination()


def test_the_problem_of_a_recording(place, world):
    recording = read_recording(place / "events.h5")
    world = replace(world, recording=recording)
    problem = world.problem()
    assert isinstance(problem.model, LambertianRing) and problem.n_pixel == world.mask.sum()
    assert world.pairs() is world.pairs()
    hot = np.zeros_like(world.mask)
    hot.ravel()[problem.pixel[0]] = True
    counts = [p.pairs.counts for p in (problem, replace(world, hot=hot).problem())]
    assert counts[0][0] > 0 and counts[1][0] == 0


def test_lobes_are_in_the_problem(place, world):
    world = replace(world, recording=read_recording(place / "events.h5"))
    label = np.zeros(world.mask.sum(), int)
    glossy = replace(world, gloss=Gloss(RoughCoating, np.array([0.2]), np.array([0.5]), label))
    assert isinstance(glossy.problem().model, GlossyRing)


def test_a_recording_without_pairs_is_named(place, world):
    recording = read_recording(place / "events.h5")
    none = replace(world, recording=replace(recording, source="mine"), mask=np.zeros_like(world.mask))
    with pytest.raises(InputError, match="^mine: No two events"):
        none.pairs()


# ---------------------------------------------------------------------- what events tell of shadows


@pytest.fixture
def latent(place, world):
    """A world that asks events for shadows, and a fit of it that knows none."""
    world = replace(world, recording=read_recording(place / "events.h5"))
    return replace(world, shadows="latent"), Fitted(world.problem(), None, None)


def test_the_problem_starts_from_what_goes_with_the_visibility(latent, monkeypatch):
    """Pixels of which no event tells have none, and did not fire."""
    world, fitted = latent
    n = fitted.problem.n_pixel
    share, untold = (
        np.ones((world.ring.leds.n_led, n), np.float32),
        np.arange(n) == np.flatnonzero(fitted.problem.fired)[1],
    )
    share[2, 5] = 0
    seen = Seen(share, np.full((n, 4), 0.5, np.float32), untold)
    monkeypatch.setattr(World, "seen", lambda self, fitted: seen)
    problem = world.problem(fitted)
    assert problem.start is seen.theta and (problem.fired == (fitted.problem.fired & ~untold)).all()
    assert problem.pairs.counts[untold].tolist() == [0] and problem.pairs.counts.sum() > 0
    assert problem.visible is share
    dark = problem.illumination.irradiance[2].numpy() == 0
    assert np.flatnonzero(dark).tolist() == [5]
    assert world.problem().start is None


def test_indirect_light_comes_where_leds_are_hidden(latent, monkeypatch):
    """The search is given what the fit had of it."""
    from evsdr.effects import world as module

    world, fitted = latent
    light = fitted.problem.illumination
    indirect = replace(light, indirect=[e * 0.1 for e in light.irradiance])
    given = []
    monkeypatch.setattr(module, "find_visibility", lambda problem, *rest: given.append(problem))
    world.seen(replace(fitted, problem=replace(fitted.problem, illumination=indirect)))
    assert given[0].illumination.indirect is indirect.indirect


@pytest.fixture
def half_hidden(latent):
    """A fit in which one pixel sees a quarter of an LED, another tells nothing, and neither thresholds nor lobes are known."""
    world, fitted = latent
    share = np.ones((world.ring.leds.n_led, fitted.problem.n_pixel), np.float32)
    share[1, 3] = 0.25
    silent = np.flatnonzero(fitted.problem.fired)[:1]
    share[2, silent] = 0
    fired = fitted.problem.fired.copy()
    fired[silent] = False
    problem = replace(
        fitted.problem, illumination=fitted.problem.illumination.seen(share), fired=fired, visible=share
    )
    theta = np.zeros((problem.n_pixel, 4), np.float32)
    return world, Fitted(problem, SimpleNamespace(all_theta=theta, threshold_prior=None), None)


def test_visibility_stays_once_a_rough_matt_part_is_known(half_hidden):
    world, fitted = half_hidden
    seen = replace(world, rough=0.3).seen(fitted)
    np.testing.assert_allclose(seen.share, fitted.problem.visible)
    assert np.flatnonzero(seen.untold).tolist() == np.flatnonzero(fitted.problem.visible[2] == 0).tolist()
    assert seen.theta is fitted.solution.all_theta


def test_lobes_may_light_what_seemed_hidden(half_hidden, monkeypatch):
    """Asked with each pixel's lobe and with that of most; pixels that see all LEDs again tell something."""
    from evsdr.effects import world as module

    world, fitted = half_hidden
    n, asked = fitted.problem.n_pixel, []
    theta = np.full((n, 4), 0.5, np.float32)

    def light_up(problems, solution, share, *rest):
        asked.extend([problems, share])
        return np.where(share == 0, np.float32(1), share), theta

    monkeypatch.setattr(module, "unhide", light_up)
    label = (np.arange(n) < 5).astype(int)
    gloss = Gloss(RoughCoating, np.array([0.2, 1.0]), np.array([0.5, 0.0]), label)
    seen = replace(world, gloss=gloss).seen(fitted)
    strengths = [np.unique(problem.lobe.strength.numpy()).tolist() for problem in asked[0]]
    assert strengths == [[0, 0.5], [0.5]]
    np.testing.assert_allclose(asked[1], fitted.problem.visible)
    assert seen.share.min() == 0.25 and not seen.untold.any() and seen.theta is theta


def test_weaker_leds_are_not_hidden(latent, monkeypatch):
    """Powers that were found since the fit change the light, and not what pixels see of it."""
    from evsdr.effects import world as module

    world, fitted = latent
    n_led, n_pixel = world.ring.leds.n_led, fitted.problem.n_pixel
    share = np.ones((n_led, n_pixel), np.float32)
    share[1, 3] = 0.25
    light = fitted.problem.illumination.seen(share)
    problems = replace(fitted.problem, illumination=light, visible=share), fitted.problem
    stronger = replace(world, aim=Aim(np.full(n_led, 0.03), np.zeros((n_led, 2))))
    given = []
    monkeypatch.setattr(
        module, "find_visibility", lambda problem, solution, share, *rest: given.append(share)
    )
    for problem in problems:
        stronger.seen(replace(fitted, problem=problem))
    np.testing.assert_array_equal(given[0], share)
    np.testing.assert_array_equal(given[1], 1)


def test_what_pixels_see_is_not_asked_twice(latent, monkeypatch):
    """Not under other light either; without shadows that events tell, never."""
    from evsdr.effects import world as module

    world, fitted = latent
    asked = []
    monkeypatch.setattr(module, "find_visibility", lambda *given: asked.append(given) or object())
    known = world.with_seen(fitted)
    n_led = world.ring.leds.n_led
    stronger = replace(world, aim=Aim(np.full(n_led, 0.03), np.zeros((n_led, 2))))
    assert known.seen is world.seen(fitted) is stronger.seen(known) and len(asked) == 1
    assert stronger.seen(fitted) is not known.seen
    assert replace(world, shadows="scene").with_seen(fitted) is fitted and len(asked) == 2


@pytest.mark.parametrize("shadows", ["none", "scene"])
def test_the_problem_tells_what_is_traced(latent, shadows):
    world, _ = latent
    visible = replace(world, shadows=shadows).problem().visible
    assert (
        visible is None if shadows == "none" else visible.shape == (world.ring.leds.n_led, world.mask.sum())
    )
