"""Effects are decided in order, and one more needs no other file."""

from dataclasses import replace

import mitsuba as mi
import numpy as np
import pytest

import evsdr
from evsdr.effects.effect import Decision
from evsdr.fitting import deciding
from evsdr.solve import trial
from tests.support.small_scene import camera, leds, scene

FAST = evsdr.Settings(preset="fast", shared=())
ALL = {"LEDs", "cast shadows", "rays per pixel", "hot pixels", "contrast thresholds", "refractory period"}
ALL |= {"set-up", "wiring", "photoreceptor lag", "light paths", "gloss", "metal", "translucency", "matt part"}
ALL |= {"LED powers", "LED directions", "shift of all times", "leak", "slot length", "background activity"}
ALL |= {"distance of the surface"}


class LateTriggers:
    """Triggers that come late by a part of a slot, as by a slow cable."""

    name, option, when = "late triggers", "", "scene"

    def decide(self, asked, world, fitted):
        row, delays = np.arange(0, world.mask.sum(), 3, dtype=np.uint32), np.arange(0.0, 5000.0, 1000.0)
        worlds = [replace(world, recording=self.early(world.recording, us)) for us in delays]
        cases = [early.problem().pairs.at(mi.UInt32(row)) for early in worlds]
        cost = trial.costs(cases, world.illumination(), row, False).sum(axis=1)
        us = float(delays[np.argmin(cost)])
        return Decision(self.name, us > 0, f"by {us:.0f} us", found={"us": us})

    def model(self, world, decision):
        return replace(world, recording=self.early(world.recording, decision.found["us"]))

    def early(self, recording, us):
        return replace(recording, round_start_us=recording.round_start_us - int(us))


@pytest.fixture
def given(place):
    return evsdr.load_scene(place / "scene.xml"), evsdr.read_recording(place / "events.h5")


def test_an_eleventh_effect(given, place, monkeypatch):
    ring, recording = given
    late = replace(recording, round_start_us=recording.round_start_us + 3000)
    with pytest.warns(evsdr.InputWarning):
        spoilt = evsdr.fit(ring, late, FAST)
    monkeypatch.setattr(deciding, "EFFECTS", (LateTriggers(), *deciding.EFFECTS))
    found = evsdr.fit(ring, late, FAST)
    effect = found.summary["effects"]["late triggers"]
    assert effect["modelled"] and effect["found"]["us"] == pytest.approx(3000, abs=300)
    assert found.summary["model"]["late triggers"] == found.decisions["late triggers"].why
    truth = np.load(place / "truth.npz")
    truth = evsdr.Truth(truth["normal"], truth["reflectance"], truth["mask"])
    error, before = (evsdr.score(fit.maps, truth)["mae_deg"] for fit in (found, spoilt))
    assert error < 0.5 * before


def test_every_effect_is_decided_on_and_reported(given):
    found = evsdr.fit(*given, FAST)
    assert set(found.decisions) == set(found.summary["effects"]) == ALL
    for name, effect in found.summary["effects"].items():
        assert set(effect) == {"modelled", "expected_deg", "found"}
        assert found.summary["model"][name] == found.decisions[name].why


@pytest.mark.filterwarnings(
    "ignore:.*come again in every round:evsdr.InputWarning"
)  # of light that is left out
@pytest.mark.parametrize(("limit_deg", "modelled"), [(0.05, True), (50.0, False)])
def test_one_limit_for_all(tmp_path, limit_deg, modelled):
    """What costs more than the limit is modelled, what costs less is not."""
    (tmp_path / "near.xml").write_text(scene(light=leds(distance=4), sensor=camera(width=20, height=20)))
    ring = evsdr.load_scene(tmp_path / "near.xml")
    recording, _ = evsdr.simulate(ring, rounds=2)
    found = evsdr.fit(ring, recording, replace(FAST, limit_deg=limit_deg))
    assert found.decisions["LEDs"].modelled == modelled
    assert 0.05 < found.decisions["LEDs"].expected_deg < 50
