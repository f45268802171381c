"""The story of a fit: when it asks what, and when it solves."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import evsdr
from evsdr.effects.blocks import at_some
from evsdr.effects.leds import LedPowers
from evsdr.effects.world import Fitted
from evsdr.fitting import deciding, sharing, story, tiling
from evsdr.fitting.decoder import Decoder
from evsdr.fitting.model_error import with_model_error
from evsdr.fitting.tiles import within
from evsdr.light.scene import RingScene
from evsdr.progress import Seconds
from evsdr.records import Events
from tests.support.small_scene import scene

FAST = evsdr.Settings(preset="fast", shared=())


@pytest.fixture
def given(place):
    return evsdr.load_scene(place / "scene.xml"), evsdr.read_recording(place / "events.h5")


def test_an_unknown_shape_is_bounded_by_a_mask_or_by_its_outline(given, tmp_path, monkeypatch):
    """Tiles of a fit, too."""
    known, recording = given
    (tmp_path / "told.xml").write_text(scene(shape='<shape type="rectangle" id="object"/>'))
    unknown, mask = evsdr.load_scene(tmp_path / "told.xml"), np.ones((known.height, known.width), bool)
    early = replace(
        recording, events=Events(*(getattr(recording.events, a)[:5] for a in "xypt"))
    )  # they tell of no outline
    monkeypatch.setattr(tiling, "AT_ONCE", 60)
    for ring, events, wanted, bounded in (
        (known, early, None, True),
        (unknown, early, mask, True),
        (unknown, early, None, False),
        (unknown, recording, None, True),
    ):
        world = story.world_of(ring, events, FAST, wanted, Seconds(None))
        tile = tiling.tiles_of(world.mask, recording.events)[0]
        assert world.surface.bounded == bounded == within(world, tile).surface.bounded


def test_what_pixels_share_is_inferred_anew_under_a_lobe(given, monkeypatch):
    """A matt fit takes gloss for other thresholds and times."""
    asked, decide = [], deciding.decide

    def listened(when, world, *rest):
        asked.append((when, world.gloss is not None, world.lag, world.aim))
        return decide(when, world, *rest)

    monkeypatch.setattr(deciding, "decide", listened)
    for preset in ("balanced", "fast"):
        asked.clear()
        evsdr.fit(*given, evsdr.Settings(gloss="lobe", preset=preset))
        assert ("alone", True, None, None) in asked  # from what is told, under the lobe
    asked.clear()
    evsdr.fit(*given, FAST)
    assert asked and not any(glossy for _, glossy, *_ in asked)


@pytest.mark.parametrize(
    "turned, sigma, asked", [([0], 0, 2), ([1, 1, 0], 4, 4), ([1] * 9, 4, story.MOST_MODELS), ([1] * 9, 6, 2)]
)
def test_surfaces_are_asked_for_until_normals_stand_still(given, monkeypatch, turned, sigma, asked):
    """Or turn by hardly more than is known of them. A lobe changes the residuals that tell it."""
    decide, times = deciding.decide, []

    def counted(when, *rest):
        times.append(when)
        return decide(when, *rest)

    monkeypatch.setattr(deciding, "decide", counted)
    monkeypatch.setattr(story, "turned_deg", lambda *_: turned[times.count("settled") - 2])
    monkeypatch.setattr(story, "open_deg", lambda _: sigma)
    evsdr.fit(*given, replace(FAST, gloss="lobe"))
    assert times.count("settled") == asked


def test_what_is_taken_back_leaves_all_as_it_was(given, monkeypatch):
    """Lobes, what pixels share under them, and what was found beside them; nothing is asked of that fit any more."""
    ring, recording = given
    decide, begun, told = deciding.decide, [], []

    def decided(when, world, fitted, *rest):
        new, changed = decide(when, world, fitted, *rest)
        if when == "settled":
            begun.append((world, fitted))
            if len(begun) == 2:
                none = replace(new.decisions["gloss"], modelled=False, taken_back=True)
                new = replace(new, decisions=new.decisions | {"gloss": none}, rough=0.1)
        return new, changed

    monkeypatch.setattr(deciding, "decide", decided)
    monkeypatch.setattr(story, "turned_deg", lambda *_: float(len(begun) < 3))
    monkeypatch.setattr(
        story, "with_model_error", lambda world, *rest: told.append(world) or with_model_error(world, *rest)
    )
    found = evsdr.fit(ring, recording, replace(FAST, gloss="lobe"))
    (plain, matt), (lobed, glossy), (after, again) = begun[:3]
    assert lobed.gloss is not None and glossy is not matt
    assert after.gloss is None and after.rough is None and again is matt
    assert after.decisions.keys() == plain.decisions.keys() | {"gloss"}
    assert not after.decisions["gloss"].taken_back and not found.decisions["gloss"].modelled
    assert len(begun) == 3 and told[0].gloss is None


def test_what_pixels_share_is_inferred_anew_once_hidden_leds_are_known(given, monkeypatch):
    """A fit that sees all LEDs takes shadows for other thresholds and times."""
    asked, decide = [], deciding.decide

    def listened(when, world, *rest):
        asked.append((when, world.shadows, world.lag, world.aim))
        return decide(when, world, *rest)

    monkeypatch.setattr(deciding, "decide", listened)
    for preset in ("balanced", "fast"):
        asked.clear()
        evsdr.fit(*given, evsdr.Settings(preset=preset, shadows="latent"))
        assert ("alone", "latent", None, None) in asked
    asked.clear()
    evsdr.fit(*given, FAST)
    assert asked and not any(shadows == "latent" for _, shadows, *_ in asked)


def test_maps_that_were_sketched_after_shadows_hear_all_events_at_last(given, monkeypatch):
    """Whether or not pixels then share anything else."""
    purposes, solve = [], Decoder.__call__

    def listened(self, problem, before=None, purpose="whole", *rest):
        purposes.append(purpose)
        return solve(self, problem, before, purpose, *rest)

    monkeypatch.setattr(Decoder, "__call__", listened)
    monkeypatch.setattr(sharing, "share_anew", lambda told, world, fitted, *rest: (world, fitted, False))
    for settings in (evsdr.Settings(), FAST):
        purposes.clear()
        evsdr.fit(*given, replace(settings, shadows="latent"))
        assert "again" in purposes[purposes.index("relit") :]


def test_a_fast_fit_infers_once_and_fits_all_pixels_once(given, monkeypatch):
    """A few are sketched, to see whether what is inferred explains them. Hidden LEDs take one more fit, for other things shared."""
    asked, solve = [], Decoder.__call__

    def listened(self, problem, before=None, purpose="whole", *rest):
        asked.append((purpose, problem.n_pixel))
        return solve(self, problem, before, purpose, *rest)

    monkeypatch.setattr(Decoder, "__call__", listened)
    monkeypatch.setattr(LedPowers, "is_clear", lambda self, found: True)
    monkeypatch.setattr(sharing, "FEW", 1)
    for shadows, rest in (("off", ["again"]), ("latent", ["relit", "again"])):
        asked.clear()
        evsdr.fit(*given, evsdr.Settings(preset="fast", gloss="off", shadows=shadows, limit_deg=1e-9))
        (first, whole), (sketch, few), *others = asked
        assert [first, sketch] == ["search", "sketch"] and others == [(name, whole) for name in rest]
        assert few <= whole


@pytest.mark.parametrize("off", [True, False])
def test_a_fast_fit_asks_its_sketches_once_more_where_leds_are_not_as_told(given, monkeypatch, off):
    """Maps were bent by that. What contradicts the events then is told by the sketches."""
    asked, noise, decide, solve = [], {}, deciding.decide, Decoder.__call__

    def decided(when, world, fitted, *rest):
        asked.append(when)
        noise[when] = fitted and fitted.solution.noise
        return decide(when, world, fitted, *rest)

    def solved(self, problem, before=None, purpose="whole", *rest):
        found = solve(self, problem, before, purpose, *rest)
        noise[purpose] = found.solution.noise
        return found

    monkeypatch.setattr(deciding, "decide", decided)
    monkeypatch.setattr(Decoder, "__call__", solved)
    monkeypatch.setattr(LedPowers, "is_clear", lambda self, found: off)
    evsdr.fit(*given, evsdr.Settings(preset="fast", gloss="off", shadows="off", limit_deg=1e-9))
    assert asked.count("alone") == 1 + off
    assert noise["together"] == noise["sketch"] != noise["search"]


@pytest.mark.parametrize(("share", "known"), [(0.5, True), (0.5, False), (1.0, True), (1.0, False)])
def test_what_pixels_share_is_inferred_from_some_where_they_are_many(given, monkeypatch, share, known):
    """Those are sketched as often as that moves maps; all once where they shall tell the shape, and all are fitted at last."""
    asked, solve = [], Decoder.__call__

    def listened(self, problem, before=None, purpose="whole", *rest):
        asked.append((purpose, problem.n_pixel))
        return solve(self, problem, before, purpose, *rest)

    def some(fitted):
        return at_some(fitted, np.arange(fitted.problem.n_pixel) < share * fitted.problem.n_pixel)

    monkeypatch.setattr(Decoder, "__call__", listened)
    monkeypatch.setattr(sharing, "sample_of", some)
    monkeypatch.setattr(LedPowers, "is_clear", lambda self, found: True)
    monkeypatch.setattr(RingScene, "shape_is_known", known)
    evsdr.fit(*given, evsdr.Settings(gloss="off", shadows="off", limit_deg=1e-9))
    whole = asked[0][1]
    few = np.count_nonzero(np.arange(whole) < share * whole)
    sketches = [("sketch", few), ("sketch", few), *[("sketch", whole)] * (share < 1 and not known)]
    assert asked == [("rough", whole), *sketches, ("again", whole)]


@pytest.mark.parametrize(
    ("settings", "names"),
    [
        ({}, {"powers", "lag", "shift", "refractory", "leak", "thresholds", "distance"}),
        (
            {"leds_told_to": 0.5},
            {"powers", "lag", "shift", "refractory", "leak", "thresholds", "distance", "directions"},
        ),
        ({"lag": "off", "refractory": "known"}, {"powers", "shift", "leak", "thresholds", "distance"}),
        ({"thresholds": "known"}, {"powers", "lag", "shift", "refractory", "leak", "distance"}),
        ({"shared": ("shift", "lag"), "lag": "off"}, {"shift"}),
        ({"shared": ()}, set()),
    ],
)
def test_what_is_unknown_of_all(settings, names):
    assert set(story.unknown_of_all(evsdr.Settings(**settings))) == names


@pytest.mark.parametrize(
    "preset, blind_one, modelled", [("balanced", 1, False), ("balanced", 2, True), ("fast", 1, False)]
)
def test_what_leaves_few_pixels_explained_is_taken_back(given, monkeypatch, preset, blind_one, modelled):
    """A sketch that knows no pixel: what was believed before it stays, and the decisions say so."""
    ring, recording = given
    real = Decoder.__call__
    purposes = []

    def blind(self, problem, before=None, purpose="whole", progress=lambda stage, share: None):
        purposes.append(purpose)
        fitted = real(self, problem, before, purpose, progress)
        if purpose != "sketch" or purposes.count("sketch") != blind_one:
            return fitted
        return replace(fitted, maps=replace(fitted.maps, mask=np.zeros_like(fitted.maps.mask)))

    monkeypatch.setattr(Decoder, "__call__", blind)
    monkeypatch.setattr(LedPowers, "is_clear", lambda self, found: True)
    settings = evsdr.Settings(preset=preset, gloss="off", shadows="off", limit_deg=1e-9)
    found = evsdr.fit(ring, recording, settings)
    sketched = {"balanced": ["rough", "sketch", "sketch"], "fast": ["search", "sketch"]}
    assert purposes == [*sketched[preset], "again"] and found.maps.mask.any()
    powers = found.decisions["LED powers"]
    why = "as found" if modelled else "as told: with what the events seem to tell"
    assert powers.modelled == modelled and powers.why.startswith(why)


def test_normals_turn_where_both_fits_know_them():
    fits = []
    for angle, known in ((0.0, [1, 1, 0]), (0.1, [1, 0, 1])):
        normal = np.broadcast_to([np.sin(angle), 0, np.cos(angle)], (1, 3, 3))
        fits.append(Fitted(None, None, SimpleNamespace(normal=normal, mask=np.array([known], bool))))
    assert story.turned_deg(*fits) == pytest.approx(np.degrees(0.1))
    unknown = Fitted(None, None, SimpleNamespace(normal=normal, mask=np.zeros((1, 3), bool)))
    assert story.turned_deg(fits[0], unknown) == 0


@pytest.mark.parametrize(("preset", "first"), [("fast", "search"), ("balanced", "rough")])
def test_all_pixels_begin_anew_where_some_did(given, monkeypatch, preset, first):
    """As those by which powers ran away sit where others explain the events less well."""
    asked, solve, look = [], Decoder.__call__, sharing.Sketcher.look

    def listened(self, problem, before=None, purpose="whole", *rest):
        asked.append((purpose, problem.n_pixel, before is None))
        return solve(self, problem, before, purpose, *rest)

    def some(fitted, enough=None):
        return at_some(fitted, np.arange(fitted.problem.n_pixel) < 0.5 * fitted.problem.n_pixel)

    monkeypatch.setattr(Decoder, "__call__", listened)
    monkeypatch.setattr(LedPowers, "is_clear", lambda self, found: True)
    monkeypatch.setattr(sharing, "sample_of", some)
    settings = evsdr.Settings(preset=preset, gloss="off", shadows="off", limit_deg=1e-9)
    for anew in (False, True):
        monkeypatch.setattr(sharing.Sketcher, "look", lambda *given: look(*given)._replace(anew=anew))
        asked.clear()
        evsdr.fit(*given, settings)
        whole = asked[0][1]
        assert asked.count((first, whole, True)) == 1 + anew
