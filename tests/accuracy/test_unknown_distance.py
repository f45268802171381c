"""LEDs near to a shape that is not known, and that does not lie where a rectangle stands for it."""

import numpy as np
import pytest

import evsdr
from evsdr.fitting.settings import SHARED
from tests.support.small_scene import camera, leds, scene

PLANE = (
    '<shape type="rectangle" id="object"><transform name="to_world"><scale value="1.1"/></transform></shape>'
)
pytestmark = pytest.mark.filterwarnings("ignore::evsdr.InputWarning")  # maps that are wrong are warned of
SIZE, BESIDE = 28, tuple(name for name in SHARED if name != "distance")


@pytest.fixture(scope="module")
def ball(tmp_path_factory):
    """A sphere whose surface lies 0.69 before the rectangle, which is at its centre, under LEDs 3.5 away; what is told of it."""
    folder, given = tmp_path_factory.mktemp("near"), {"light": leds(24, distance=3.5)}
    given["sensor"] = camera(width=SIZE, height=SIZE)
    true, told = folder / "true.xml", folder / "told.xml"
    true.write_text(scene(**given))
    told.write_text(scene(**given, shape=PLANE))
    recording, truth = evsdr.simulate(evsdr.load_scene(true), rounds=4, seed=3, thresholds="nominal")
    return evsdr.load_scene(told), recording, truth


def test_the_events_tell_the_distance_of_the_surface(ball, monkeypatch):
    """And once more when the shape is known: by then light is traced on it."""
    from evsdr.fitting import sharing  # which needs the backend

    told, recording, truth = ball
    asked, again = [], sharing.share_anew

    def share_anew(as_told, world, *rest):
        asked.append(world.moved)
        return again(as_told, world, *rest)

    monkeypatch.setattr(sharing, "share_anew", share_anew)
    found = evsdr.fit(told, recording, evsdr.Settings(gloss="off"), mask=truth.mask)
    assert asked == [True]
    decision = found.decisions["distance of the surface"]
    mean = np.mean(np.sqrt(1 - np.minimum(radius_squared(truth.mask), 1)))
    assert decision.modelled and decision.found["nearer"] == pytest.approx(mean, abs=0.05)
    off = decision.answer.distance_off
    assert (
        0 < off.moving <= decision.found["nearer_sigma"] < 0.03 and off.vague == 0 and 0 < off.turns_deg < 1
    )
    error = evsdr.score(found.maps, truth)["mae_deg"]
    known = truth.mask & found.maps.mask
    angle = evsdr.angular_error_deg(found.maps.normal, truth.normal)[known]
    within = np.mean(angle <= found.maps.normal_sigma_deg[known])
    assert error < 0.6 and within > 0.6
    assert np.median(found.maps.reflectance[known] / truth.reflectance[known]) == pytest.approx(1, abs=0.03)
    assert np.mean(found.depth.depth[truth.mask]) == pytest.approx(4 - decision.found["nearer"], abs=1e-3)


def test_without_it_maps_are_wrong(ball):
    told, recording, truth = ball
    found = evsdr.fit(told, recording, evsdr.Settings(gloss="off", shared=BESIDE), mask=truth.mask)
    decision = found.decisions["distance of the surface"]
    assert not decision.modelled and decision.why == "as told: asked for by --shared"
    assert evsdr.score(found.maps, truth)["mae_deg"] > 2


def radius_squared(mask):
    """Give the squared distance of pixels of the sphere from its axis."""
    x = ((np.arange(SIZE) + 0.5) / SIZE * 2 - 1) * 1.4
    return (x**2 + x[:, None] ** 2)[mask]
