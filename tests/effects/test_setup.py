"""Gross errors of a set-up are found by what they contradict, named, and mended."""

from dataclasses import replace

import numpy as np
import pytest

from evsdr import EventPixel, Schedule, simulate
from evsdr.effects import setup
from evsdr.effects.hollow import told_by_shadows
from evsdr.effects.hypotheses import Hypothesis
from evsdr.effects.setup import SetUp, Wiring, find_error, leaders
from evsdr.effects.world import Terms
from evsdr.light.ground_truth import object_normals
from evsdr.metrics import angular_error_deg
from tests.support.setups import SIZE, fitted_alone, recorded, scene_of
from tests.support.worlds import SmallWorld

LAST = SIZE - 1


def moved(x, y):
    """Move events."""

    def spoil(recording):
        events = recording.events
        new = [np.asarray(f(events.x, events.y), np.uint16) for f in (x, y)]
        return replace(recording, events=replace(events, x=new[0], y=new[1]))

    return spoil


def scheduled(**change):
    """Tell something else of the schedule."""

    def spoil(recording):
        new = {name: f(getattr(recording.schedule, name)) for name, f in change.items()}
        return replace(recording, schedule=replace(recording.schedule, **new))

    return spoil


def sensed(factor):
    """Tell other thresholds."""

    def spoil(recording):
        names = ("contrast_threshold_on", "contrast_threshold_off")
        new = {name: factor * getattr(recording.sensor, name) for name in names}
        return replace(recording, sensor=replace(recording.sensor, **new))

    return spoil


def flipped(recording):
    events = recording.events
    return replace(recording, events=replace(events, p=(1 - events.p).astype(np.int8)))


def in_unit(us):
    """Tell times in another unit."""

    def spoil(recording):
        events = replace(recording.events, t=(recording.events.t / us).astype(np.int64))
        return replace(recording, events=events, round_start_us=(recording.round_start_us / us).astype(int))

    return spoil


SPOILT = [  # one of each kind, of which test_hypotheses.py has all
    ("the image is mirrored in x", moved(lambda x, y: LAST - x, lambda x, y: y)),
    ("the image is mirrored in y", moved(lambda x, y: x, lambda x, y: LAST - y)),
    ("the image is turned by 90 degrees clockwise", moved(lambda x, y: LAST - y, lambda x, y: x)),
    ("x and y of the image are swapped", moved(lambda x, y: y, lambda x, y: x)),
    ("the order of the LEDs is rolled: it starts with 0, 1, 2", scheduled(order=lambda o: np.roll(o, 8))),
    ("LEDs 3 and 10 are swapped", scheduled(order=lambda o: np.select([o == 3, o == 10], [10, 3], o))),
    ("polarities are flipped", flipped),
    ("the LEDs fade into each other", scheduled(crossfade=lambda c: 0.0)),
    ("slots last 0.1 times what is told", scheduled(slot_us=lambda us: 10 * us)),
    ("times are in ms", in_unit(1e3)),
    ("contrast thresholds are not as told", sensed(2.0)),
]


MENDED = [SPOILT[k][0] for k in (0, 4, 5)]


@pytest.mark.filterwarnings("ignore::evsdr.errors.InputWarning")  # of times
@pytest.mark.parametrize(("what", "spoil"), SPOILT, ids=[what for what, _ in SPOILT])
def test_what_is_told_wrong_is_found_and_mended(what, spoil):
    told = spoil(recorded()[0])
    world, fitted = fitted_alone(scene_of(), told)
    found = find_error(world, fitted)
    assert found is not None and found.hypothesis.what == what, found
    assert "with that" in found.evidence and str(found).startswith(what)
    if not found.hypothesis.leds:
        assert not Wiring().decide("", world, fitted).modelled
        decision = SetUp().decide(False, world, fitted)
        assert not decision.modelled and decision.found["error"] == what and decision.answer is found
        decision = SetUp().decide(True, world, fitted)
        assert decision.modelled and what in decision.warning and found.hypothesis.remedy in decision.warning
    else:
        decision = Wiring().decide("", world, fitted)
        assert decision.modelled and decision.found == {"leds": [3, 10]}
        assert decision.warning.startswith("LEDs 3 and 10 are swapped, say the events")
        assert not SetUp().decide(True, world, fitted).modelled
    if what in MENDED:
        mended = (Wiring() if found.hypothesis.leds else SetUp()).model(world, decision)
        world, fitted = fitted_alone(scene_of(), mended.recording)
        maps = fitted.maps
        angle = angular_error_deg(maps.normal, object_normals(scene_of()))[maps.mask]
        assert np.median(angle) < 2 and find_error(world, fitted) is None


@pytest.mark.parametrize(("what", "spoil"), [SPOILT[k] for k in (0, 1, 4)])
def test_a_shape_that_is_not_known_tells_by_curl_and_shadows(what, spoil):
    """Mirrored in x or in y are the same but for a surface that is hollow; a relief's shadows are too few to tell them apart."""
    found = find_error(*fitted_alone(scene_of("relief_unknown"), spoil(recorded("relief")[0])))
    named = " ".join(
        (found.hypothesis.what, *found.others)
    )  # a mirror turns normals as another order of the LEDs does
    assert what in named or ("mirrored" in what and "the order of the LEDs is reversed" in named)
    assert "the curl that no surface has" in found.evidence
    assert len(found.others) <= 3


def test_shadows_tell_half_a_turn_of_an_unknown_shape():
    """It leaves no curl; but a hollow sphere would have had shadows."""
    ring, right = scene_of("relief_unknown"), recorded()[0]
    turned = moved(lambda x, y: LAST - x, lambda x, y: LAST - y)(right)
    for recording, doubtful in ((right, False), (turned, True)):
        world, fitted = fitted_alone(ring, recording)
        hollow, decision = told_by_shadows(world, fitted), SetUp().decide(False, world, fitted)
        assert hollow.doubtful == doubtful and not hollow.open and not decision.modelled
        assert ("raised and hollow change places" in decision.doubt) == doubtful


def test_where_no_shadow_tells_it_the_summary_says_so():
    """It is no reason to doubt a fit."""
    world, fitted = fitted_alone(scene_of("relief_unknown"), recorded("relief")[0])
    assert told_by_shadows(world, fitted).open
    decision = SetUp().decide(False, world, fitted)
    assert not decision.modelled and not decision.doubt and not decision.answer
    assert "no shadow tells a raised surface from a hollow one" in decision.why


def test_those_that_explain_as_much_are_all_tried_again():
    hypotheses = [Hypothesis(name, "", None) for name in "abcdefgh"]
    totals = dict(zip(hypotheses, (9.0, 9.1, 9.2, 9.3, 9.0, 5.0, 4.0, 0.1)))
    assert {h.what for h in leaders(totals)} == set("abcde")
    totals = dict(zip(hypotheses, (9.0, 7.0, 6.0, 5.0, 0.1)))
    assert [h.what for h in leaders(totals)] == ["a", "b", "c"]
    assert leaders({hypotheses[0]: 0.1}) == []


@pytest.mark.parametrize(("veil", "words"), [("0", "there is constant light"), ("0.5", "10 times too large")])
def test_constant_light_that_is_told_wrong(veil, words):
    found = find_error(*fitted_alone(scene_of("sphere", veil), recorded()[0]))
    assert words in found.hypothesis.what and "constant_light" in found.hypothesis.remedy


@pytest.mark.parametrize(("name", "crossfade"), [("sphere", 0.0), ("sphere", 0.3), ("relief", 1.0)])
def test_no_alarm_where_all_is_told_right(name, crossfade):
    ring = scene_of("relief_unknown" if name == "relief" else name)
    assert find_error(*fitted_alone(ring, recorded(name, crossfade)[0])) is None


def test_how_leds_fade_is_found_between_what_is_tried():
    """And mended by `--repair`."""
    told = scheduled(crossfade=lambda c: 0.5)(recorded("sphere", 0.3)[0])
    world, fitted = fitted_alone(scene_of(), told)
    found = find_error(world, fitted)
    assert found.hypothesis.what.startswith("the LEDs fade within ") and not found.others
    mended = found.hypothesis.mend(world).recording.schedule.crossfade
    assert mended == pytest.approx(0.3, abs=0.015) and f"crossfade = {mended:.3g}" in found.hypothesis.remedy


def test_leds_that_switch_and_are_told_to_fade_are_found():
    schedule = Schedule(np.arange(24, dtype=np.int32), 3000.0, 0.0)
    recording, _ = simulate(scene_of(), EventPixel(), schedule, 4, 3, "nominal")
    world, fitted = fitted_alone(scene_of(), scheduled(crossfade=lambda c: 1.0)(recording))
    found = find_error(world, fitted)
    assert found.hypothesis.what == "the LEDs switch without fading" and not found.others
    assert found.hypothesis.mend(world).recording.schedule.crossfade == 0


@pytest.mark.parametrize(("slot_us", "crossfade"), [(1000.0, 0.3), (1500.0, 1.0)])
def test_photoreceptors_that_lag_by_a_slot_are_no_other_fade(slot_us, crossfade):
    """Another fade explains some of the lag."""
    schedule = Schedule(np.arange(24, dtype=np.int32), slot_us, crossfade)
    recording, _ = simulate(scene_of(), EventPixel(), schedule, 6, 3, "nominal")
    assert find_error(*fitted_alone(scene_of(), recording)) is None


def test_few_pixels_convict_nobody(monkeypatch):
    monkeypatch.setattr(setup, "find_crossfade", lambda *_: None)
    world, fitted = fitted_alone(scene_of(), flipped(recorded()[0]))
    few = np.zeros((SIZE, SIZE), bool)
    few[10:14, 10:14] = True
    problem = replace(fitted.problem, grid=replace(fitted.problem.grid, mask=few))
    assert find_error(world, replace(fitted, problem=problem)) is None


def test_adam_looks_for_no_error():
    world = SmallWorld(None, terms=Terms(solver="adam"))
    for effect in (SetUp(), Wiring()):
        decision = effect.decide(True, world, None)
        assert not decision.modelled and "solver adam" in decision.why
