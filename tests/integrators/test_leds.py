"""The LEDs of a scene: which there are, in what order, and what the camera sees of their spectra."""

import mitsuba as mi
import numpy as np
import pytest
from evsdr.integrators.leds import emitter_id

from evsdr.model.quadrature import TOLERANCE
from tests.support.ring_scenes import POWER, far, load, near, peak, plane, render, ring, soft


def test_leds_are_ordered_by_natural_id_and_others_left_out():
    power = {"led_10": 5.0, "led_2": 3.0, "sun": 100.0, "led_01": 2.0, "led_33": 7.0}
    emitters = {name: far((0, 0, 1), p) for name, p in power.items()}
    scene = load({"led_9": soft((0, 0, 5), 0.1), "object": plane(), "led_0": soft((0, 1, 5), 0.1)} | emitters)
    integrator = ring()
    order = ["led_0", "led_01", "led_2", "led_9", "led_10", "led_33"]
    assert [emitter_id(e) for e in integrator.leds(scene).emitter] == order
    signal = np.array(integrator.render(scene, spp=1))[0, 0] / POWER
    np.testing.assert_allclose(signal[[1, 2, 4, 5]], [2, 3, 5, 7], rtol=1e-5)
    assert (signal[[0, 3]] < 0.01).all()


def test_bands():
    spectra = [peak(525), peak(525, 3.0), peak(460, 2.0), peak(527, 4.0), peak(460, 0.1)]
    scene = load({"object": plane()} | {f"led_{j}": far((0, 0, 1), s) for j, s in enumerate(spectra)})
    leds = ring().leds(scene)
    assert leds.band.tolist() == [0, 0, 1, 2, 1]
    np.testing.assert_allclose(leds.power, [1, 3, 2, 4, 0.1], rtol=1e-4)
    np.testing.assert_allclose(leds.band_wavelength_nm, [525, 460, 527], atol=0.01)


def test_the_centroid_is_that_of_what_the_camera_sees():
    """A triangle from 500 to 600 nm with its peak at 500, seen by a response that rises from 0."""
    led = far((0, 0, 1), [(499.999, 0.0), (500, 1.0), (600, 0.0)])
    leds = ring(response=[(500, 0.0), (600, 1.0)]).leds(load({"object": plane(), "led_0": led, "led_1": led}))
    assert leds.band_wavelength_nm[0] == pytest.approx(550, abs=0.5)
    flat = ring().leds(load({"object": plane(), "led_0": led, "led_1": led}))
    assert flat.band_wavelength_nm[0] == pytest.approx(500 + 100 / 3, abs=0.5)


def test_power_of_near_and_soft_leds():
    leds = {"led_0": near((9, 0, 5), peak(500, 2.0)), "led_1": soft((1, 0, 5), 0.1, peak(600, 4.0))}
    found = ring(response=[(400, 0.5), (700, 0.5)]).leds(load({"object": plane()} | leds))
    np.testing.assert_allclose(found.power, [1, 2], rtol=1e-4)
    assert [found.is_far(0), found.is_far(1)] == [False, False]


@pytest.mark.parametrize("unit", [1e-6, 1e9])
def test_power_of_near_leds_in_any_unit_of_length(unit):
    leds = {f"led_{j}": near((9 * unit, 0, 5 * unit), peak(500, 2.0 + j)) for j in range(2)}
    found = ring().leds(load({"object": plane(half_width=(unit, unit, 1))} | leds))
    np.testing.assert_allclose(found.power, [2, 3], rtol=1e-4)


def test_wherever_a_scene_ends_an_led_has_one_power():
    """To the last bit, also a spot that faces away from where it ends: kernels hold these numbers."""
    spot = {"type": "spot", "intensity": {"type": "irregular", "wavelengths": "400, 700", "values": "2, 3"}}
    spot["to_world"] = mi.ScalarTransform4f().look_at([0.3, 0.1, 4], [0, 0, 0], [0, 1, 0])
    emitters = {"led_0": near((9, 0.7, 5), peak(500, 2.0)), "led_1": far((0, 0, 1), peak(500)), "led_2": spot}
    found = []
    for height in (0.0, 0.371, -2.093):
        block = {"type": "sphere", "center": [0, 0, height], "radius": 0.1}
        leds = ring().leds(load({"object": plane(), "block": block} | emitters))
        found.append(np.concatenate([leds.power, leds.peak_nm, leds.peak]))
    np.testing.assert_array_equal(found[1:], found[:1] * 2)
    np.testing.assert_allclose(found[0][:2], [2, 1], rtol=1e-4)
    assert found[0][2] > 100


def test_scene_without_leds():
    with pytest.raises(ValueError, match="no emitter has an id that starts with 'led'"):
        render(load({"object": plane(), "sun": far((0, 0, 1))}))


def test_led_that_the_camera_cannot_see():
    scene = load({"object": plane(), "led_0": far((0, 0, 1)), "led_1": far((0, 0, 1), peak(750))})
    with pytest.raises(ValueError, match="'led_1' gives the camera no light"):
        render(scene, response=[(400, 1.0), (650, 1.0)])


def sharp(*steps):
    """A reflectance with edges, 0.1 nm wide: (wavelength, value from there on)."""
    points = [(360, 0.1)]
    for nm, value in steps:
        points += [(nm - 0.1, points[-1][1]), (nm, value)]
    return [*points, (830, points[-1][1])]


REFLECTANCES = [sharp((550, 0.9)), sharp((500, 0.9), (560, 0.2), (600, 0.7)), [(360, 0.1), (830, 0.9)]]
SPECTRA = {
    "narrow LED": peak(545, 1.0),
    "wide LED": peak(560, 1.0, 35.0),
    "laser": [(531.99, 0.0), (532, 100.0), (532.01, 0.0)],
    "laser between wavelengths": [(560.24, 0.0), (560.25, 100.0), (560.26, 0.0)],
}


@pytest.mark.parametrize("name", SPECTRA)
@pytest.mark.parametrize("k", range(len(REFLECTANCES)))
def test_spectra_with_edges_and_lines(name, k):
    """What is rendered is INT E R over INT E, and power is INT E, by brute force."""
    spectrum, reflectance = SPECTRA[name], REFLECTANCES[k]
    scene = load(
        {"object": plane(reflectance), "led_0": far((0, 0, 1), spectrum), "led_1": far((0, 0, 1), spectrum)}
    )
    integrator = ring()
    power = integrator.leds(scene).power[0]
    found = np.array(integrator.render(scene, spp=1))[3, 3, 0] / power
    nm = np.linspace(spectrum[0][0], spectrum[-1][0], 200_001)
    density, value = (np.interp(nm, *zip(*curve)) for curve in (spectrum, reflectance))
    assert power == pytest.approx(np.trapezoid(density, nm), rel=2e-3)
    assert found == pytest.approx(density @ value / density.sum(), abs=TOLERANCE)
