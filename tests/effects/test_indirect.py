"""Light by way of other surfaces: decided by what it does to normals, gathered as the renderer does."""

from types import SimpleNamespace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from evsdr.effects.indirect import IndirectLight
from evsdr.light.ground_truth import surface_maps
from evsdr.light.tracing import led_images, trace_illumination, trace_indirect
from tests.conftest import REPOSITORY
from tests.support.small_scene import DIFFUSE, camera, leds, scene
from tests.support.worlds import load, world_of


def test_gathered_light_is_that_of_the_renderer(tmp_path):
    """True normals and reflectances on a true relief: paths of two surface points, as the integrator renders."""
    relief = f"""<shape type="ply" id="object"><string name="filename" value="{REPOSITORY}/scenes/relief.ply"/>
        {DIFFUSE}</shape>"""
    ring = load(tmp_path, scene(shape=relief, light=leds(4), sensor=camera(width=32, height=32)))
    direct = led_images(ring, 64, 1).reshape(4, -1)
    ring.integrator.max_depth = 2
    reference = led_images(ring, 256, 1).reshape(4, -1) - direct
    maps = surface_maps(ring, 16)
    light, _ = trace_illumination(ring, 16, True, 1)
    indirect = trace_indirect(ring, maps, light, 2, 1, 0.0)
    reflectance, mask = maps.reflectance.reshape(-1, 2), maps.mask.ravel()
    gathered = np.array([reflectance[:, b] * e.numpy() for b, e in zip(light.band, indirect)])[:, mask]
    reference = reference[:, mask]
    assert reference.mean() > 0.05 * direct.mean()
    assert gathered.mean() == pytest.approx(reference.mean(), rel=0.08)
    assert np.corrcoef(gathered.ravel(), reference.ravel())[0, 1] > 0.9


def test_nothing_else_means_no_indirect_light(tmp_path):
    """A sphere alone sees no other surface."""
    ring = load(tmp_path, scene())
    light, _ = trace_illumination(ring, 4, False)
    indirect = trace_indirect(ring, surface_maps(ring, 4), light, 3, 1, 0.0)
    assert max(float(dr.max(e)[0]) for e in indirect) < 1e-6


def test_indirect_light_joins_signal_and_its_slope():
    """LambertianRing: the derivative by log reflectance stays the signal, that by slopes stays the direct one's."""
    from dataclasses import replace

    from evsdr.model.illumination import Illumination
    from evsdr.model.lambert import LambertianRing, led_signals

    light = Illumination([mi.Vector3f(0.6, 0, 0.8)] * 2, [mi.Float(1.0)] * 2, [0, 1], mi.Float(0.05))
    more = replace(light, indirect=[mi.Float(0.1), mi.Float(0.0)])
    p, q, reflectance = mi.Float(0.1), mi.Float(0.2), [mi.Float(0.5), mi.Float(0.25)]
    alone = LambertianRing(light)(p, q, reflectance, mi.Float(1e-4))
    joined = LambertianRing(more)(p, q, reflectance, mi.Float(1e-4))
    for j, extra in enumerate((0.05, 0.0)):
        assert float((joined[0][j] - alone[0][j])[0]) == pytest.approx(extra, abs=1e-6)
        assert float(joined[1][j][0]) == float(alone[1][j][0])
    normal = dr.normalize(mi.Vector3f(-0.1, -0.2, 1))
    assert float(led_signals(more, normal, reflectance)[0][0]) == pytest.approx(
        float(joined[0][0][0]), abs=1e-5
    )
    kept = more.gather(mi.UInt32(0))
    assert kept.indirect is not None


def fitted(ring):
    return SimpleNamespace(maps=surface_maps(ring, 4))


def test_a_relief_lights_itself_and_a_sphere_does_not(tmp_path):
    relief = f"""<shape type="ply" id="object"><string name="filename" value="{REPOSITORY}/scenes/relief.ply"/>
        {DIFFUSE}</shape>"""
    for shape, counts in ((relief, True), (scene.__defaults__[-1], False)):
        ring = load(tmp_path, scene(shape=shape, sensor=camera(width=24, height=24)))
        ring.integrator.max_depth = 2
        decision = IndirectLight().decide("auto", world_of(ring), fitted(ring))
        assert decision.modelled == counts == (decision.expected_deg > 0.05)
        assert decision.why.startswith(
            "direct and indirect" if counts else "direct light only: indirect light"
        )


def test_an_unknown_shape_lights_itself_as_its_fit_does(tmp_path):
    """Far LEDs and no shadows: a placeholder, which is flat, would send nothing to itself."""
    relief = f"""<shape type="ply" id="object"><string name="filename" value="{REPOSITORY}/scenes/relief.ply"/>
        {DIFFUSE}</shape>"""
    flat = f'<shape type="rectangle" id="object">{DIFFUSE}</shape>'
    known, unknown = (
        load(tmp_path, scene(shape=s, sensor=camera(width=24, height=24))) for s in (relief, flat)
    )
    found = []
    for ring in (known, unknown):
        ring.integrator.max_depth = 2
        fit = fitted(known)
        grid = SimpleNamespace(mask=fit.maps.mask)
        fit = SimpleNamespace(maps=fit.maps, problem=SimpleNamespace(grid=grid))
        found.append(IndirectLight().decide("auto", world_of(ring), fit).expected_deg)
    assert found[1] == pytest.approx(found[0], rel=0.5) and found[0] > 0.5


@pytest.mark.parametrize("asked", ["auto", "direct", "indirect"])
def test_what_is_asked_for_is_done(tmp_path, asked):
    ring = load(tmp_path, scene())
    decision = IndirectLight().decide(asked, world_of(ring), fitted(ring))
    assert decision.modelled == (asked == "indirect")
    assert decision.why.endswith(
        "max_depth of the scene is 1" if asked == "auto" else f"--light-paths {asked}"
    )
