"""A ring is judged for the object of a scene, from Python."""

import json
from dataclasses import replace

import numpy as np
import pytest

import evsdr
from evsdr.events.record import ring_schedule
from evsdr.limits.judge import judge, limit_of, render_object
from evsdr.solve.shared.rig import Told
from tests.support.small_scene import DIFFUSE, HEIGHT, SPHERE, WIDTH, scene

PIXEL = evsdr.EventPixel(event_noise=0.1).idealised()


@pytest.fixture(scope="module")
def ring(tmp_path_factory):
    path = tmp_path_factory.mktemp("judged") / "scene.xml"
    path.write_text(scene())
    return evsdr.load_scene(path)


def test_bound_and_judgement_are_of_the_same_object(ring):
    rendering, schedule = render_object(ring, 4, 0), ring_schedule(8)
    limit = limit_of(ring, rendering, schedule, 2, PIXEL)
    found, bound = judge(ring, rendering, limit, schedule), limit.told
    mask = rendering.truth.mask
    assert bound.normal_sigma_deg.shape == mask.shape == (HEIGHT, WIDTH)
    assert found["bound"]["pixels"] == mask.sum()
    known = bound.normal_sigma_deg[mask] < 30
    assert found["bound"]["share_normal_known"] == known.mean()
    assert found["bound"]["normal_deg_median"] == np.median(bound.normal_sigma_deg[mask][known])
    assert found["bound"]["normal_deg_rms"] == np.sqrt(np.mean(bound.normal_sigma_deg[mask][known] ** 2))
    assert found["bound"]["pairs_per_pixel"] == limit.n_pair[mask].mean() > 5
    assert found["bound_shared_unknown"]["normal_deg_median"] > found["bound"]["normal_deg_median"]
    assert found["shared_sigma"]["refractory_us"] == limit.shared.refractory * schedule.slot_us > 0
    assert 0 < found["shared_sigma"]["leak_per_s"] < Told().leak
    assert 0 < found["shared_sigma"]["powers"] < 0.05 and found["shared_sigma"]["directions_deg"] < 0.5
    lit = rendering.signal[:, mask]
    assert found["median_led_signal"] == np.median(lit[lit > 0])
    assert [led["id"] for led in found["leds"]] == [f"led_{j:03d}" for j in range(8)]
    json.dumps(found, allow_nan=False)


def test_gloss_decides_which_leds_are_safe(ring):
    rendering, schedule = render_object(ring, 1, 0), ring_schedule(8)
    limit = limit_of(ring, rendering, schedule, 1, PIXEL)
    sharp, wide = (judge(ring, rendering, limit, schedule, shininess) for shininess in (32.0, 2.0))
    assert all(led["inside_safe_range"] for led in sharp["leds"])  # at 45 degrees
    assert wide["safe_polar_deg"] is None and not any(led["inside_safe_range"] for led in wide["leds"])


def test_a_hard_switch_is_named(ring):
    rendering, schedule = render_object(ring, 1, 0), replace(ring_schedule(8), crossfade=0.0)
    found = judge(ring, rendering, limit_of(ring, rendering, schedule, 2, PIXEL), schedule)
    assert [p for p in found["problems"] if "switch hard" in p]
    fading = judge(ring, rendering, limit_of(ring, rendering, ring_schedule(8), 2, PIXEL), ring_schedule(8))
    assert len(fading["problems"]) == len(found["problems"]) - 1


def test_what_can_not_be_judged(ring, tmp_path):
    far = SPHERE.replace(DIFFUSE, f'<point name="center" x="20" y="0" z="0"/>{DIFFUSE}')
    (tmp_path / "scene.xml").write_text(scene(shape=far))
    with pytest.raises(evsdr.InputError, match="scene.xml: the camera does not see the shape object"):
        render_object(evsdr.load_scene(tmp_path / "scene.xml"), 1, 0)
    numb = evsdr.EventPixel(50.0, 50.0).idealised()
    with pytest.raises(evsdr.InputError, match="no pixel of the object fires two events"):
        limit_of(ring, render_object(ring, 1, 0), ring_schedule(8), 2, numb)
