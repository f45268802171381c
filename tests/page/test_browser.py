"""The page in a browser: it says nothing on the console, shows the values of the arrays, and its lamp is the renderer."""

import base64
import json
import re
from dataclasses import replace

import numpy as np
import pytest

from evsdr.files.daylight import daylight_weights, reflectance_to_srgb
from evsdr.light.camera import camera_geometry
from evsdr.light.ground_truth import object_depth, surface_maps
from evsdr.light.scene import load_scene
from evsdr.light.tracing import trace_illumination
from evsdr.page.document import page
from evsdr.shape.traced import depth_of, masked_mesh
from tests.support.chromium import open_page
from tests.support.page_controls import press, put, text
from tests.support.page_fits import make_fit
from tests.support.small_scene import camera, leds, scene


def picture(browser, canvas):
    """Give the pixels (H, W, 4) of a canvas."""
    data = browser.evaluate(
        f"(() => {{ const c = document.getElementById({canvas!r}), copy = new OffscreenCanvas(c.width, c.height)"
        ".getContext('2d', {willReadFrequently: true}); copy.drawImage(c, 0, 0);"
        " const d = copy.getImageData(0, 0, c.width, c.height).data;"
        " return [c.height, c.width, btoa(String.fromCharCode(...d))]; })()"
    )
    return np.frombuffer(base64.b64decode(data[2]), np.uint8).reshape(*data[:2], 4)


# ---------------------------------------------------------------------- values


def test_values_are_those_of_the_arrays(opened, fit):
    for y, x in np.argwhere(fit.stored)[::17]:
        v = opened.evaluate(f"evsdr.valuesOf({x}, {y})")
        k = np.flatnonzero(fit.signals.pixel == y * fit.maps.mask.shape[1] + x)[0]
        np.testing.assert_allclose(v["normal"], fit.maps.normal[y, x], atol=2e-5)
        np.testing.assert_allclose(v["reflectance"], fit.maps.reflectance[y, x], atol=1e-5)
        np.testing.assert_allclose(v["light"], fit.signals.modelled[k], rtol=1e-4)
        np.testing.assert_allclose(v["change"], fit.signals.change[k], rtol=0.03, atol=2e-3)
        np.testing.assert_allclose(v["change_sigma"], fit.signals.sigma[k], rtol=0.02)
        assert v["events"] == fit.signals.count[k]
        if fit.maps.mask[y, x]:
            np.testing.assert_allclose(v["reflectance_sigma"], fit.maps.reflectance_sigma[y, x], rtol=0.02)
            assert v["normal_sigma_deg"] == pytest.approx(fit.maps.normal_sigma_deg[y, x], rel=1e-4)
            assert v["depth"] == pytest.approx(fit.depth.depth[y, x], abs=1e-4)
        else:
            assert v["normal_sigma_deg"] is None and v["depth"] is None


def test_maps_are_painted_at_their_place(opened, fit):
    """Row 0 is the top; what is not known is left out."""
    press(opened, "tab-maps")
    opened.evaluate("new Promise(done => setTimeout(done, 100))")
    shown = picture(opened, "flat")
    np.testing.assert_array_equal(shown[..., 3] > 0, fit.maps.mask)
    expected = np.round(255 * (fit.maps.normal + 1) / 2)
    assert np.abs(shown[..., :3].astype(int) - expected)[fit.maps.mask].max() <= 1


def test_a_band_is_painted_by_its_values(opened, fit):
    press(opened, "tab-maps")
    put(opened, "map", "band_0", "change")
    opened.evaluate("new Promise(done => setTimeout(done, 100))")
    low, high = (float(opened.evaluate(f"document.getElementById({n!r}).value")) for n in ("low", "high"))
    known, grey = fit.maps.mask, picture(opened, "flat")[..., 0]
    expected = np.clip((fit.maps.reflectance[..., 0] - low) / (high - low), 0, 1)
    assert low == 0 and 0.9 < high <= 1.01
    assert np.abs(grey / 255 - expected)[known].max() < 0.01
    words = text(opened, "map-numbers")
    assert f"over {np.count_nonzero(known)} pixels" in words
    assert float(words.split()[1].rstrip(",")) == pytest.approx(
        np.median(fit.maps.reflectance[..., 0][known]), abs=0.02
    )


def test_a_pixel_in_words_and_numbers(opened, fit):
    y, x = np.argwhere(fit.maps.mask)[50].tolist()
    opened.evaluate(f"evsdr.choose({x}, {y})")
    words = text(opened, "pixel-words")
    assert f"Column {x}, row {y}: normal (" in words
    assert f"1 σ {float(f'{fit.maps.normal_sigma_deg[y, x]:.2g}'):g}°" in words
    table = text(opened, "pixel-table")
    assert str(float(f"{fit.maps.reflectance[y, x, 1]:.4g}")) in table
    assert opened.evaluate("document.querySelectorAll('#spectrum circle').length") == 3
    assert opened.evaluate("document.querySelectorAll('#signals circle').length") == 6


def test_outside_the_object(opened):
    opened.evaluate("evsdr.choose(0, 0)")
    assert text(opened, "pixel-words") == "Column 0, row 0: outside the object."
    assert text(opened, "spectrum") == text(opened, "pixel-table") == ""


# ---------------------------------------------------------------------- light


def encoded(linear):
    linear = np.clip(linear, 0, 1)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def relit(browser, shape, strength, seen, **light):
    """Give the picture (H, W, 3), 0..1, under a light."""
    light = {"near": False, "ambient": 0, "gain": 1} | light
    data = browser.evaluate(
        f"(() => {{ evsdr.under({json.dumps(strength)}, {seen!r});"
        f" return btoa(String.fromCharCode(...evsdr.relight({json.dumps(light)}))); }})()"
    )
    return np.frombuffer(base64.b64decode(data), np.uint8).reshape(*shape, 4)[..., :3] / 255


@pytest.fixture
def rendered(browser, tmp_path):
    """Give a matt sphere under LEDs, half of them near, as the renderer shows it; and the page of its true maps."""
    light = leds(4) + leds(4, distance=2.5).replace("led_00", "led_10")
    (tmp_path / "scene.xml").write_text(scene(light=light, sensor=camera(width=24, height=20)))
    ring = load_scene(tmp_path / "scene.xml", {"constant_light": "0"})
    image = np.array(ring.integrator.render(ring.scene, ring.sensor, spp=1))
    maps = surface_maps(ring, 1)
    geometry, _ = camera_geometry(ring.sensor)
    depth = depth_of(maps, maps.mask, geometry, object_depth(ring))
    depth = replace(depth, depth=object_depth(ring).astype(float))
    open_page(browser, tmp_path / "page.html", page(maps, {"verdict": "trustworthy"}, depth=depth))
    return browser, ring, image, maps


def test_lamp_equals_the_renderer(rendered):
    """A far LED alone, seen by the camera: signals of the ring integrator within 1/255, as the screen shows them."""
    browser, ring, image, maps = rendered
    illumination = trace_illumination(ring, 1, False, 1)[0]
    for j in range(4):
        direction = [float(c[0]) for c in illumination.direction[j]]
        strength = [float(b == ring.leds.band[j]) for b in range(ring.leds.n_band)]
        shown = relit(browser, maps.mask.shape, strength, "camera", direction=direction)
        expected = encoded(image[..., j] / ring.leds.power[j])[..., None]
        assert np.ptp(expected[maps.mask]) > 0.5
        assert np.abs(shown - expected)[maps.mask].max() <= 1 / 255


def test_a_near_lamp_equals_the_renderer(rendered):
    """A point LED: inverse squares and directions from the depth."""
    browser, ring, image, maps = rendered
    for j in range(4, 8):
        azimuth = np.pi / 2 * (j - 4)
        place = 2.5 * np.array([np.cos(azimuth), np.sin(azimuth), 1]) / 2**0.5 - (0, 0, 4)  # from the camera
        strength = [float(b == ring.leds.band[j]) for b in range(ring.leds.n_band)]
        light = {"near": True, "place": place.tolist(), "reach": 2.0, "gain": 0.25}
        shown = relit(browser, maps.mask.shape, strength, "camera", **light)
        expected = encoded(image[..., j] / ring.leds.power[j])[..., None]
        assert np.ptp(expected[maps.mask]) > 0.2
        assert np.abs(shown - expected)[maps.mask].max() <= 1.01 / 255


def test_colour_ambient_and_brightness(opened, fit):
    direction = np.array([0.3, -0.4, 0.866])
    strength = [1.0, 0.5, 1.5]
    shade = 0.2 + np.maximum(fit.maps.normal @ (direction / np.linalg.norm(direction)), 0)
    colour = (fit.maps.reflectance * strength) @ daylight_weights(fit.maps.band_wavelength_nm)
    light = {"direction": direction.tolist(), "ambient": 0.2, "gain": 0.7}
    shown = relit(opened, fit.maps.mask.shape, strength, "eye", **light)
    expected = encoded(0.7 * colour * shade[..., None])
    assert np.abs(shown - expected)[fit.stored].max() <= 1 / 255
    assert not shown[~fit.stored].any()


def test_daylight_is_the_picture(opened, fit):
    shown = relit(opened, fit.maps.mask.shape, [1, 1, 1], "eye", direction=[0, 0, 1], ambient=1, gain=1)
    front = relit(opened, fit.maps.mask.shape, [1, 1, 1], "eye", direction=[0, 0, -1], ambient=1, gain=1)
    colour = reflectance_to_srgb(fit.maps.reflectance, fit.maps.band_wavelength_nm)
    assert np.abs(front - colour)[fit.stored].max() <= 1 / 255
    assert (shown >= front).all()


# ---------------------------------------------------------------------- shape and other fits


def test_mesh_has_the_triangles_of_the_file(opened, fit):
    press(opened, "tab-shape")
    expected = masked_mesh(fit.depth, fit.maps, np.eye(4))
    known = np.flatnonzero(fit.depth.mask & fit.maps.mask)
    face = np.reshape(opened.evaluate("Array.from(evsdr.mesh.face, i => evsdr.fit.pixel[i])"), (-1, 3))
    assert sorted(map(tuple, face)) == sorted(map(tuple, known[expected.face]))
    assert len(face) > 50


def test_two_fits_are_compared(opened, fit, tmp_path):
    """With a page and with a maps.npz, compressed or not; the difference is that of the arrays."""
    other = make_fit(5)
    turned = fit.maps.normal + np.float32(0.05)
    turned /= np.linalg.norm(turned, axis=-1, keepdims=True)
    maps = replace(other.maps, normal=turned, mask=fit.maps.mask)
    arrays = {k: v for k, v in vars(maps).items()}
    np.savez(tmp_path / "plain.npz", **arrays)
    np.savez_compressed(tmp_path / "small.npz", **arrays)
    text_of_other = replace(other, maps=maps).page().replace("<style>", "<style>/* of another version */")
    (tmp_path / "other.html").write_text(text_of_other, encoding="utf-8")
    angle = np.degrees(np.arccos(np.clip((maps.normal * fit.maps.normal).sum(-1), -1, 1)))[
        fit.maps.mask
    ].mean()
    for name in ("plain.npz", "small.npz", "other.html"):
        node = opened.send("Runtime.evaluate", expression="document.getElementById('other')")["result"][
            "objectId"
        ]
        opened.evaluate("document.getElementById('compare-numbers').textContent = ''")
        opened.send("DOM.setFileInputFiles", files=[str(tmp_path / name)], objectId=node)
        words = opened.evaluate(
            "new Promise(done => { const t = setInterval(() => { const w = document.getElementById("
            "'compare-numbers').textContent; if (w) { clearInterval(t); done(w); } }, 50); })"
        )
        assert f"Over {np.count_nonzero(fit.maps.mask)} pixels known in both" in words
        assert float(words.split("differ by ")[1].split("°")[0]) == pytest.approx(angle, rel=0.02)
        assert name in text(opened, "other-name")
    press(opened, "tab-compare")
    put(opened, "split", "50")
    opened.evaluate("new Promise(done => setTimeout(done, 150))")
    shown, half = picture(opened, "flat")[..., :3].astype(int), fit.maps.mask.shape[1] // 2
    for part, normal in ((np.s_[:, :half], fit.maps.normal), (np.s_[:, half:], maps.normal)):
        expected = np.round(255 * (normal + 1) / 2)[part]
        assert np.abs(shown[part] - expected)[fit.maps.mask[part]].max() <= 1
    put(opened, "way", "difference", "change")
    opened.evaluate("new Promise(done => setTimeout(done, 150))")
    np.testing.assert_array_equal(picture(opened, "flat")[..., 3] > 0, fit.maps.mask)
    assert re.fullmatch(r"Colours from 0° \(dark\) to [\d.]+° \(bright\)\.", text(opened, "compare-scale"))
    assert opened.messages == []


def test_a_file_that_is_none_is_refused_in_words(opened, tmp_path):
    (tmp_path / "bad.npz").write_bytes(b"nothing of that kind")
    node = opened.send("Runtime.evaluate", expression="document.getElementById('other')")["result"][
        "objectId"
    ]
    opened.send("DOM.setFileInputFiles", files=[str(tmp_path / "bad.npz")], objectId=node)
    opened.evaluate("new Promise(done => setTimeout(done, 200))")
    assert text(opened, "other-name") == "bad.npz can't be compared: it is no .npz."
    assert opened.messages == []
