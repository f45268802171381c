"""What pixels share is inferred once, and each effect takes its part, or says why not."""

from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import mitsuba as mi
import numpy as np
import pytest

from evsdr.effects import shared
from evsdr.effects.clock import TimeShift
from evsdr.effects.effect import Decision
from evsdr.effects.lag import PhotoreceptorLag
from evsdr.effects.leak import Leak
from evsdr.effects.leds import LedDirections, LedPowers
from evsdr.effects.memo import Memo
from evsdr.effects.near_leds import DistanceOfNearLeds
from evsdr.effects.payment import widened
from evsdr.effects.refractory import Refractory
from evsdr.effects.shared import Aim, find_shared, plus_minus
from evsdr.effects.thresholds import ThresholdScale
from evsdr.effects.world import Fitted, Terms
from evsdr.model.illumination import Illumination
from evsdr.records import Maps
from evsdr.solve.shared.pixels import vector_of
from evsdr.solve.shared.rig import GROUPS, NAMES, Told
from tests.support.shared_unknowns import Case, power_errors
from tests.support.shared_worlds import FITTED, decision, found, world
from tests.support.sphere import solve, sphere_recording
from tests.support.worlds import SmallWorld, problem_of

EFFECTS = (
    LedPowers,
    LedDirections,
    DistanceOfNearLeds,
    TimeShift,
    Refractory,
    ThresholdScale,
    PhotoreceptorLag,
    Leak,
)


@pytest.mark.parametrize("kind", EFFECTS)
@pytest.mark.parametrize(
    ("terms", "words"),
    [
        (Terms(solver="adam", thorough=False), "as told: the solver adam infers nothing but maps"),
        (Terms(shared=()), "as told: asked for by --shared"),
    ],
)
def test_when_nothing_is_inferred(kind, terms, words):
    decision = kind().decide("auto", world(terms), None)
    assert not decision.modelled and decision.why == words and decision.effect == kind.name


@pytest.mark.parametrize("kind", EFFECTS)
def test_what_is_left_out_alone_is_as_told(kind):
    shared = tuple(group for group in GROUPS if group != kind.group)
    decision = kind().decide("auto", world(Terms(shared=shared), found()), FITTED)
    assert not decision.modelled and decision.why.endswith("--shared")


@pytest.mark.parametrize("kind", EFFECTS)
def test_too_few_pixels_tell_nothing(kind, monkeypatch):
    monkeypatch.setattr("evsdr.effects.shared.find_shared", lambda world, fitted: None)
    decision = kind().decide("auto", world(), FITTED)
    assert not decision.modelled and decision.why == "as told: too few pixels tell it"


@pytest.mark.parametrize("kind", EFFECTS)
@pytest.mark.parametrize(("limit_deg", "modelled"), [(0.1, True), (0.3, False)])
def test_one_limit_for_all(kind, limit_deg, modelled):
    """What turns normals by 0.2 degrees."""
    decision = kind().decide("auto", world(Terms(limit_deg=limit_deg), found()), FITTED)
    assert decision.modelled == modelled and decision.expected_deg == 0.2
    assert decision.why.startswith("as found: " if modelled else "as told: ") and decision.found


def test_an_aim_changes_powers_and_directions():
    vectors = [mi.Vector3f(0, 0, 1), mi.Vector3f(1, 0, 0)]
    light = Illumination(vectors, [mi.Float(2.0), mi.Float([1.0, 3.0])], [0, 0], mi.Float(0.1))
    aimed = Aim(np.log([1.1, 0.5]), np.array([[0.0, 0.0], [0.1, 0.0]]))(light)
    np.testing.assert_allclose(aimed.irradiance[0].numpy(), [2.2], rtol=1e-6)
    np.testing.assert_allclose(aimed.irradiance[1].numpy(), [0.5, 1.5], rtol=1e-6)
    np.testing.assert_allclose(vector_of(aimed.direction[0]), [0, 0, 1], atol=1e-7)
    turn = np.arccos(vector_of(aimed.direction[1])[0])
    assert turn == pytest.approx(np.arctan(0.1), rel=1e-4)


def test_near_leds_are_not_turned():
    near = Illumination([mi.Vector3f([0, 1], 0, 1)] * 2, [mi.Float(1.0)] * 2, [0, 0], mi.Float(0.1))
    assert Aim(np.zeros(2), np.ones((2, 2)))(near).direction is near.direction


def test_values_are_written_with_their_sigma():
    assert plus_minus((51.23, 0.456)) == "51.2 +- 0.46 us"


@dataclass(frozen=True)
class RealWorld(SmallWorld):
    """With what an inference looks at."""

    decisions: dict = field(default_factory=dict)
    found: object = None
    ring, background, clock_us, distance_is_unknown = None, None, 0.0, False

    @property
    def memo(self):
        return self.__dict__.setdefault("_memo", Memo())


def given(case):
    """As by default: directions are as told."""
    terms = Terms(shared=tuple(group for group in GROUPS if group != "directions"))
    return RealWorld(case.recording, terms=terms), Fitted(case.problem, case.solution, None)


def test_what_pixels_share_is_found_once():
    case = Case.sphere(size=18, wrong={"log_power": power_errors()}, event_noise=0.05)
    world, fitted = given(case)
    answer = find_shared(world, fitted)
    assert find_shared(world, fitted) is answer and answer.slot_us == 10_000
    assert answer.us("refractory")[0] == answer.inferred.rig.refractory * 10_000
    decision = LedPowers().decide("auto", world, fitted)
    assert decision.modelled and decision.answer is answer and decision.expected_deg > 0.3
    assert np.std(np.log(decision.found["power_factor"]) - power_errors()) < 0.02


@pytest.mark.parametrize("thorough", [True, False])
def test_a_search_takes_off_its_own_bias_once(thorough, monkeypatch):
    """What follows has the same taken off, and starts where the search had ended; the preset fast takes nothing off."""
    asked, asks = [], shared.own_bias
    monkeypatch.setattr(shared, "own_bias", lambda *given: asked.append(1) or asks(*given))
    case = Case.sphere(size=18, cutoff_hz=3000.0, photon_rate_per_us=100.0, event_noise=0.05)
    world, fitted = given(case)
    world = replace(world, terms=replace(world.terms, thorough=thorough))
    first = find_shared(world, fitted)
    again = shared._infer(replace(world, found=first), fitted)
    assert len(asked) == thorough
    assert again.off is first.off and (first.off is not None and first.off.any()) == thorough
    start = shared._start(replace(world, found=first), fitted, first.inferred.rig, np.arange(2), 1.0)
    assert start.rig is first.searched
    assert (first.searched.vector != first.inferred.rig.vector).any() == thorough


def test_an_untold_refractory_period_is_found():
    """Guessed as 52 us, it is 300: told it would hardly be that far off."""
    recording, light, normal, mask = sphere_recording(18, event_noise=0.05, refractory_us=300.0)
    sensor = replace(recording.sensor, refractory_us=52.0, guessed=("refractory_us",))
    case = Case(replace(recording, sensor=sensor), light, normal, mask)
    decision = Refractory().decide("auto", *given(case))
    assert decision.found["refractory_us"]["found_us"] == pytest.approx(300, abs=30)
    assert decision.found["refractory_us"]["told_us"] == 52.0
    assert decision.answer.told.refractory_us == 200  # a guess is a wide prior


def test_a_lag_is_modelled_where_there_is_one():
    tau_us = 1e6 / (2 * np.pi * 3000)
    case = Case.sphere(size=18, event_noise=0.05, cutoff_hz=3000.0)
    decision = PhotoreceptorLag().decide("auto", *given(case))
    assert decision.modelled and decision.found["tau_us"] == pytest.approx(tau_us, rel=0.15)
    assert "late" in decision.why


@pytest.mark.parametrize(
    "tau, noise, turn_deg, lags",
    [(5, 0, 1, True), (5, 0, 0.01, False), (2, 8, 1, False), (2, 20, 1, True), (2, 20, 0.01, False)],
)
def test_noise_counts_where_light_is_too_slow_for_a_lag(tau, noise, turn_deg, lags):
    """Values in standard deviations; noise of thresholds passes for a little of it."""
    rig, sigma = SimpleNamespace(tau=tau, noise=0.01 * noise), SimpleNamespace(tau=1, noise=0.01)
    found = SimpleNamespace(rig=rig, sigma=sigma, turn_deg={"lag": turn_deg}, no_lag=False)
    assert shared._lags(found, SimpleNamespace(terms=Terms())) == lags
    assert not shared._lags(SimpleNamespace(**vars(found) | {"no_lag": True}), SimpleNamespace(terms=Terms()))


def test_where_there_is_no_lag_the_search_begins_from_the_maps(monkeypatch):
    """One with a lag may have left them far behind; scatter of thresholds alone passes for no lag, and biases nothing."""
    starts, infer = [], shared.infer

    def listened(pixels, start, *rest):
        starts.append(start)
        return infer(pixels, start, *rest)

    monkeypatch.setattr(shared, "infer", listened)
    case = Case.sphere(size=18, thresholds=True, event_noise=0.3)
    found = find_shared(*given(case))
    assert len(starts) == 2 and starts[1] is starts[0] and "tau" not in found.names
    np.testing.assert_array_equal(starts[0].theta, case.solution.all_theta[case.row])
    assert np.abs(found.inferred.rig.log_threshold).max() < 0.05 and found.untold_deg == 0


@pytest.mark.parametrize(("cutoff_hz", "asked"), [(0.0, [False]), (3000.0, [False, True])])
def test_a_lag_that_was_none_is_asked_for_again_only_where_events_want_it(cutoff_hz, asked, monkeypatch):
    """What a search without one is off by is taken off, too."""
    lag_asked, infer = [], shared.infer

    def listened(pixels, start, rig, told, names, *rest):
        lag_asked.append("tau" in names)
        return infer(pixels, start, rig, told, names, *rest)

    monkeypatch.setattr(shared, "infer", listened)
    world, fitted = given(Case.sphere(size=18, thresholds=True, event_noise=0.1, cutoff_hz=cutoff_hz))
    before = replace(decision(LedPowers()), answer=replace(found(), no_lag=True))
    again = find_shared(replace(world, decisions={"before": before}), fitted)
    assert lag_asked == asked and ("tau" in again.names) == bool(cutoff_hz) == (not again.no_lag)
    assert again.off.any()


@pytest.mark.parametrize(
    ("scatter", "noise", "surprise", "expected"),
    [
        (0.005, 0.02, -2.0, "quiet"),
        (0.005, 0.02, 2.0, "noisy"),
        (0.005, 0.02, -0.1, "noisy"),
        (0.1, 0.02, -2.0, "noisy"),
        (0.005, 0.001, -2.0, "noisy"),
    ],
)
def test_noise_that_took_all_scatter_is_left_out_if_that_is_far_less_of_a_surprise(
    scatter, noise, surprise, expected, monkeypatch
):
    """What follows then leaves it out from the start."""
    asked = []

    def infer(pixels, start, rig, told, names, *rest):
        asked.append(names)
        of, noisy = found(tau=0.3, noise=noise if "noise" in names else 0.0).inferred, "noise" in names
        sigma = replace(of.sigma, tau=0.01, noise=0.001)
        cost = 0.0 if noisy else surprise * pixels.n_event
        of = replace(of, sigma=sigma, scatter=scatter, surprise=cost, theta=start.theta)
        return replace(of, turn_deg=dict.fromkeys(GROUPS, 1.0), wanted=dict.fromkeys(NAMES, 0.0))

    monkeypatch.setattr(shared, "infer", infer)
    case = Case.sphere(size=18, thresholds=True, event_noise=0.1, cutoff_hz=3000.0)
    world, fitted = given(case)
    world = replace(world, terms=replace(world.terms, thorough=False))
    first = find_shared(world, fitted)
    assert ("noise" in first.names) == (expected == "noisy") and "tau" in first.names
    assert len(asked) == (2 if scatter < shared.EXACT and noise == 0.02 else 1)
    asked.clear()
    before = replace(first, names=(*first.names, "directions"))
    again = shared._infer(replace(world, found=before), fitted)
    assert again.names == first.names
    assert expected == "noisy" or asked == [first.names]


@pytest.mark.parametrize(("scatter", "n_search"), [(0.1, 2), (0.6, 1)])
def test_where_a_search_was_in_vain_nothing_more_is_sought(scatter, n_search, monkeypatch):
    """No dark current, though events want one, and no bias of the search's own."""
    asked, biased = [], []

    def infer(pixels, start, rig, told, names, *rest):
        asked.append(names)
        of = replace(found(tau=0.3).inferred, scatter=scatter, theta=start.theta)
        of = replace(of, sigma=replace(of.sigma, tau=0.01), wanted=dict.fromkeys(NAMES, 9.0))
        return replace(of, turn_deg=dict.fromkeys(GROUPS, 1.0))

    monkeypatch.setattr(shared, "infer", infer)
    monkeypatch.setattr(
        shared, "own_bias", lambda found, pixels, recording, told, names: biased.append(names)
    )
    monkeypatch.setattr(shared, "corrected", lambda found, *_: found)
    find_shared(*given(Case.sphere(size=18, thresholds=True, event_noise=0.1, cutoff_hz=3000.0)))
    assert len(asked) == n_search and bool(biased) == (scatter == 0.1)
    assert ("dark" in asked[-1]) == (n_search == 2)


@pytest.mark.parametrize("tau, asked, expected", [(0.0, True, 0.02), (0.3, True, 0.3), (0.0, False, 0.0)])
def test_a_search_for_a_lag_begins_with_one_though_none_was_found(tau, asked, expected):
    """At a usual one, or at that which was found."""
    terms, last = Terms(shared=("lag",) if asked else ()), found(tau=tau)
    solution = SimpleNamespace(threshold_prior=None, all_theta=np.zeros((2, 4)), noise=0.1)
    start = shared._start(
        world(terms, found=last), SimpleNamespace(solution=solution), last.inferred.rig, np.arange(2), 1.0
    )
    assert start.rig.tau == pytest.approx(expected) and (start.rig.noise > 0) == (expected == 0.02)


def test_what_is_not_asked_for_is_not_inferred():
    assert find_shared(SimpleNamespace(terms=Terms(shared=())), None) is None


def test_few_pixels_tell_nothing():
    recording, light, normal, mask = sphere_recording(18, event_noise=0.05)
    few = np.zeros_like(mask)
    few[6:11, 6:11] = True
    assert find_shared(*given(FewPixels(recording, light, few))) is None


class FewPixels:
    def __init__(self, recording, light, mask):
        self.recording, self.problem = recording, problem_of(recording, light, mask)
        self.solution = solve(self.problem)


def maps_of_two() -> Maps:
    """One pixel that is known to 0.4 degrees and 0.01, and one that is not."""
    normal = np.broadcast_to(np.float32([0, 0, 1]), (1, 2, 3))
    sigma = np.float32([[0.4, 180.0]])
    of_reflectance = np.float32([[[0.5], [0.5]]]), sigma < 90, sigma, np.float32([[[0.01], [1.0]]])
    return Maps(normal, *of_reflectance, np.ones(1))


def fit_of_two(prior: tuple | None = None) -> SimpleNamespace:
    """A fit with these maps, whose mean thresholds are these."""
    light = SimpleNamespace(band=[0, 0, 0])
    solution, problem = SimpleNamespace(threshold_prior=prior), SimpleNamespace(illumination=light)
    return SimpleNamespace(maps=maps_of_two(), solution=solution, problem=problem)


def wide_under(fitted: SimpleNamespace, gloss=None, **decisions: Decision) -> Maps:
    return widened(fitted, SimpleNamespace(decisions=decisions, gloss=gloss))


def test_what_is_left_open_of_what_pixels_share_widens_sigmas():
    """Of known pixels: 0.3 degrees, and two percent of the reflectance."""
    fitted, none = fit_of_two(), Decision("b", False, "")
    wide = wide_under(fitted, a=decision(LedPowers()), b=none)
    np.testing.assert_allclose(wide.normal_sigma_deg, [[0.5, 180]])
    np.testing.assert_allclose(wide.reflectance_sigma[..., 0], [[np.hypot(0.01, 0.01), 1]], rtol=1e-3)
    assert wide_under(fitted, b=none) is fitted.maps
    untold = decision(LedPowers())
    untold = replace(untold, answer=replace(untold.answer, untold_deg=1.2))
    np.testing.assert_allclose(wide_under(fitted, a=untold).normal_sigma_deg, [[1.3, 180]])


@pytest.mark.parametrize(("open_", "scaled"), [(0.3, True), (0.5, False)])
def test_no_scale_is_known_where_what_pixels_share_leaves_it_open(open_, scaled):
    fitted, told = fit_of_two(), decision(LedPowers())
    fitted.maps = replace(fitted.maps, mask_reflectance=fitted.maps.mask)
    inferred = replace(told.answer.inferred, log_reflectance_sigma=np.array([open_]))
    wide = wide_under(fitted, a=replace(told, answer=replace(told.answer, inferred=inferred)))
    assert wide.mask_reflectance.tolist() == [[scaled, False]] and wide.mask.tolist() == [[True, False]]


def test_thresholds_of_the_maps_that_are_others_than_those_inferred_widen_sigmas():
    """Unless a lobe is why: by how the pixels' maps follow C_on and C_off, 0.1 and 0.05 apart."""
    response = np.zeros((1, 3, len(shared.Basis.of(NAMES, [0, 0, 0]).owner)))
    here = shared.Basis.of(NAMES, [0, 0, 0]).owner == "thresholds"
    response[:, :, here] = np.array([[0.1, 0.0], [0.0, 0.0], [0.5, 0.4]])
    answer = found(log_threshold=np.array([0.1, 0.2]))
    inferred = replace(answer.inferred, theta=np.zeros((1, 3)), response=response)
    told = replace(decision(LedPowers()), answer=replace(answer, inferred=inferred))

    def wide(prior, gloss=None):
        return wide_under(fit_of_two(prior), gloss, a=told)

    alike = wide((0.1, 0.2, 0.1, 0.1))
    np.testing.assert_array_equal(alike.normal_sigma_deg, wide(None).normal_sigma_deg)
    apart = wide((0.2, 0.15, 0.1, 0.1))
    turned = np.degrees(0.1 * 0.1)
    assert apart.normal_sigma_deg[0, 0] == pytest.approx(np.hypot(0.5, turned), rel=1e-3)
    moved = 0.5 * 0.1 - 0.4 * 0.05
    expected = np.sqrt(0.01**2 + 0.5**2 * (0.02**2 + moved**2))
    assert apart.reflectance_sigma[0, 0, 0] == pytest.approx(expected, rel=2e-3)
    lobes = wide((0.2, 0.15, 0.1, 0.1), gloss="lobes")
    np.testing.assert_array_equal(lobes.reflectance_sigma, alike.reflectance_sigma)


@pytest.mark.parametrize(("surprise", "expected"), [(5.0, -2.0), (20.0, 0.2)])
def test_thresholds_that_run_away_are_searched_again_from_what_is_told(surprise, expected, monkeypatch):
    """First with thresholds that stay; what is less of a surprise stands."""
    names, asked = ("powers", "thresholds"), []

    def infer(pixels, start, rig, told, some, activity):
        asked.append((some, start.rig.log_threshold[0], start.theta[0, -2:].tolist()))
        value = {1: -2.0, 2: 0.0, 3: 0.2}[len(asked)]
        of = found(log_threshold=np.full(2, value)).inferred
        return replace(of, theta=start.theta, surprise=surprise if len(asked) == 1 else 10.0)

    monkeypatch.setattr(shared, "infer", infer)
    rig, light = found(log_threshold=np.zeros(2)).inferred.rig, SimpleNamespace(n_band=1)
    theta = np.array([[0.0, 0.0, 0.0, -0.7, -0.5]])
    start = shared.Start(theta, replace(rig, log_threshold=np.full(2, -0.6)), np.ones(2), 0.1)
    search = shared.Asked(SimpleNamespace(light=light), start, rig, Told(), names, None)
    assert search.search(names).rig.log_threshold[0] == expected
    assert [some for some, *_ in asked] == [names, ("powers",), names]
    assert [at for _, at, _ in asked] == [-0.6, 0.0, 0.0]
    np.testing.assert_allclose([moved for *_, moved in asked], [[-0.7, -0.5], [-0.1, 0.1], [-0.1, 0.1]])
    assert (start.theta == [[0.0, 0.0, 0.0, -0.7, -0.5]]).all()
    asked.clear()
    search.search(("powers",))
    assert len(asked) == 1
