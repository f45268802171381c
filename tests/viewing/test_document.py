"""The page of `evsdr.view` in a browser: it says nothing on the console and shows the values of the arrays."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from evsdr.records import Signals
from evsdr.viewing.checks import examine
from evsdr.viewing.document import page
from evsdr.viewing.look import look_at
from tests.support.chromium import open_page
from tests.support.watched_files import CONSTANT_LIGHT, N_LED, ball_signal, lamp_recording, recorded, watched


@pytest.fixture(scope="module")
def recording():
    return recorded()


def page_of(look):
    return page(look, examine(look), "python -m evsdr.view ball.h5", "2026-01-02 03:04")


def modelled(look):
    """Give a look with a fit that knows the true light of every third pixel."""
    light = ball_signal().reshape(N_LED, -1).T + CONSTANT_LIGHT
    pixel = np.arange(0, len(light), 3)
    zero = np.zeros((len(pixel), N_LED), np.float32)
    counts = np.zeros(len(pixel))
    ring = np.zeros(N_LED, int), np.zeros((N_LED, 3))
    signals = Signals(
        pixel, light[pixel].astype(np.float32), zero, zero, counts, counts, *ring, CONSTANT_LIGHT
    )
    solution = SimpleNamespace(threshold_gain=None, noise=0.05)
    fit = SimpleNamespace(signals=signals, solution=solution, decisions={}, contradicted=False)
    return replace(look, fit=fit), light


def test_a_pixel_shows_its_events(browser, recording, tmp_path):
    look, light = modelled(look_at(watched(recording)))
    open_page(browser, tmp_path / "page.html", page_of(look))
    events, (y, x) = recording.events, (8, 8)  # 8 * 20 + 8 is a multiple of three
    mine = (events.x == x) & (events.y == y)
    shown = browser.evaluate(f"evsdr.course({x}, {y})")
    t = np.array([e["t"] for e in shown["events"]])
    np.testing.assert_allclose(t, events.t[mine] - events.t[0], atol=look.watched.seconds * 10)
    np.testing.assert_array_equal([e["up"] for e in shown["events"]], events.p[mine] == 1)
    assert shown["on"] == np.count_nonzero(events.p[mine]) > 10
    on, off = np.mean(events.p[mine]), np.mean(1 - events.p[mine])
    threshold = recording.sensor.contrast_threshold_on[y, x]
    levels = threshold * np.cumsum(np.where(events.p[mine] == 1, 1, -on / off))
    np.testing.assert_allclose([e["level"] for e in shown["events"]], levels, atol=1e-3)
    knots = np.array(browser.evaluate(f"evsdr.model({x}, {y})"))[::12]
    expected = np.log(light[y * 20 + x][np.append(np.arange(N_LED), 0)])
    np.testing.assert_allclose(np.diff(knots[:, 1]), np.diff(expected), atol=0.03)
    assert browser.evaluate(f"evsdr.model({x + 1}, {y})") is None


def test_pictures_count_events(browser, recording, tmp_path):
    open_page(browser, tmp_path / "page.html", page_of(look_at(watched(recording))))
    view = browser.evaluate("({on: Array.from(evsdr.view.on), slots: evsdr.view.schedule.on})")
    events = recording.events
    on = events.p == 1
    np.testing.assert_array_equal(view["on"], np.bincount(events.y[on] * 20 + events.x[on], minlength=400))
    slot = (events.t[on] // 20_000) % N_LED
    np.testing.assert_array_equal(view["slots"], np.bincount(slot, minlength=N_LED))
    there = (events.t // 20_000) % N_LED == 3
    expected = np.bincount(events.y[there] * 20 + events.x[there], minlength=400)
    assert (
        np.abs(browser.evaluate("evsdr.slot(3)") - expected).sum() <= 0.01 * there.sum()
    )  # times are rounded
    browser.evaluate("document.querySelectorAll('#slots .slot')[3].dispatchEvent(new MouseEvent('click'))")
    assert browser.evaluate("document.getElementById('map').value") == "slot_3"
    assert browser.evaluate("document.querySelectorAll('#slots .chosen').length") == 1


def test_pixels_without_stored_events_show_their_neighbours(browser, recording, tmp_path):
    look = look_at(watched(recording))
    open_page(browser, tmp_path / "page.html", page(look, examine(look), most_events=800))
    stride = browser.evaluate("evsdr.view.stride")
    counts = np.reshape(browser.evaluate("evsdr.slot(3)"), (20, 20))
    assert stride > 1 and counts.any()
    np.testing.assert_array_equal(
        counts, np.kron(counts[::stride, ::stride], np.ones((stride, stride)))[:20, :20]
    )


def test_a_click_chooses_a_pixel_and_keys_move_it(browser, recording, tmp_path):
    open_page(browser, tmp_path / "page.html", page_of(look_at(watched(recording))))
    left, top, width, height = browser.evaluate(
        "(() => { const f = document.getElementById('frame'); f.scrollIntoView({block: 'center'});"
        " const b = f.getBoundingClientRect(); return [b.left, b.top, b.width, b.height]; })()"
    )
    place = {"x": left + 0.3 * width, "y": top + 0.7 * height}
    for kind in ("mousePressed", "mouseReleased"):
        browser.send("Input.dispatchMouseEvent", type=kind, button="left", buttons=1, clickCount=1, **place)
    words = "document.getElementById('pixel-words').textContent"
    assert browser.evaluate(words).startswith("Column 6, row 14: ")
    browser.evaluate("document.getElementById('frame').focus()")
    for kind in ("keyDown", "keyUp"):
        browser.send("Input.dispatchKeyEvent", type=kind, key="ArrowRight", code="ArrowRight")
    assert browser.evaluate(words).startswith("Column 7, row 14: ")


def test_everything_that_acts_has_a_name(browser, tmp_path):
    text = page_of(look_at(watched(lamp_recording(100.0), order=np.arange(N_LED).repeat(3))))
    open_page(browser, tmp_path / "page.html", text, size=(390, 844), phone=True, dark=True)
    assert browser.evaluate("document.documentElement.scrollWidth") <= 390
    for node in browser.send("Accessibility.getFullAXTree")["nodes"]:
        acting = {"button", "spinbutton", "combobox", "application", "img"}
        if node.get("role", {}).get("value") in acting and not node.get("ignored"):
            assert node.get("name", {}).get("value"), node


def test_hostile_names_do_nothing(browser, recording, tmp_path):
    file = replace(watched(recording), path=tmp_path / "<img src=x onerror='hacked = 1'>.h5")
    open_page(browser, tmp_path / "page.html", page_of(look_at(file)))
    assert browser.evaluate("typeof hacked") == "undefined"
    assert browser.evaluate("document.querySelector('h1').textContent").startswith("<img src=x")


def test_without_a_schedule(browser, recording, tmp_path):
    file = replace(watched(recording), schedule=None)
    open_page(browser, tmp_path / "page.html", page_of(look_at(file)))
    hidden = "['slots-figure', 'folded-figure'].every((id) => document.getElementById(id).hidden)"
    assert browser.evaluate(hidden)
    assert browser.evaluate("document.querySelectorAll('#course polyline').length") == 1
