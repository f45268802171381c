"""The page in hand: pointers, fingers and keys, screens and paper of any size, texts and fits of any kind."""

from dataclasses import replace

import numpy as np
import pytest

from evsdr.page.document import page
from tests.support.chromium import open_page
from tests.support.page_controls import drag, frame_box, key, press, value
from tests.support.page_fits import HOSTILE

DESK, PHONE = (1280, 900), (390, 844)


def test_dragging_moves_the_lamp_and_a_click_chooses_a_pixel(opened):
    drag(opened, (0.5, 0.5), (0.5, 0.15))
    assert value(opened, "azimuth") == pytest.approx(90, abs=3) and 10 < value(opened, "elevation") < 70
    before = value(opened, "azimuth")
    drag(opened, (0.7, 0.3), (0.7, 0.3))
    assert value(opened, "azimuth") == before
    assert (value(opened, "column"), value(opened, "row")) == (12, 4)  # of 18 x 14


def test_a_finger_moves_the_lamp(browser, fit, tmp_path):
    open_page(browser, tmp_path / "page.html", fit.page(), size=PHONE, phone=True)
    browser.send("Emulation.setTouchEmulationEnabled", enabled=True)
    try:
        left, top, width, height = frame_box(browser)
        for kind, share in (("touchStart", 0.5), ("touchMove", 0.7), ("touchMove", 0.9), ("touchEnd", None)):
            points = [] if share is None else [{"x": left + share * width, "y": top + 0.5 * height}]
            browser.send("Input.dispatchTouchEvent", type=kind, touchPoints=points)
    finally:
        browser.send("Emulation.setTouchEmulationEnabled", enabled=False)
    assert value(browser, "azimuth") == pytest.approx(0, abs=4) and value(browser, "elevation") < 30


def test_a_picture_is_enlarged_about_the_chosen_pixel(opened):
    """A click then shows the pixel that lies there; drags in maps move the picture."""
    press(opened, "tab-maps")
    opened.evaluate("evsdr.choose(12, 4)")
    for _ in range(5):
        press(opened, "nearer")  # 7.6 times
    for x, y in ((0.32, 0.5), (0.68, 0.5), (0.5, 0.32), (0.5, 0.68)):  # a pixel is 0.42 of the frame wide
        drag(opened, (x, y), (x, y))
        assert (value(opened, "column"), value(opened, "row")) == (12, 4)
    drag(opened, (0.75, 0.5), (0.75, 0.5))
    assert (value(opened, "column"), value(opened, "row")) == (13, 4)
    drag(opened, (0.2, 0.5), (0.2 + 7.594 * 3 / 18, 0.5))  # three columns to the right
    drag(opened, (0.5, 0.5), (0.5, 0.5))
    assert value(opened, "column") == 9
    for _ in range(8):
        press(opened, "farther")
    drag(opened, (0.01, 0.01), (0.01, 0.01))
    assert (value(opened, "column"), value(opened, "row")) == (0, 0)


def test_keys_do_what_pointers_do(opened):
    opened.evaluate("document.getElementById('tab-light').focus()")
    key(opened, "ArrowRight")
    assert opened.evaluate("document.activeElement.id") == "tab-maps"
    assert not opened.evaluate("document.getElementById('panel-maps').hidden")
    opened.evaluate("document.getElementById('frame').focus()")
    x, y = value(opened, "column"), value(opened, "row")
    key(opened, "ArrowRight")
    key(opened, "ArrowDown")
    assert (value(opened, "column"), value(opened, "row")) == (x + 1, y + 1)
    press(opened, "tab-shape")
    opened.evaluate("document.getElementById('frame').focus()")
    key(opened, "ArrowRight")
    assert value(opened, "yaw") == 5
    press(opened, "tab-light")
    opened.evaluate("document.getElementById('frame').focus()")
    before = value(opened, "elevation")
    key(opened, "ArrowUp")
    assert value(opened, "elevation") != before or value(opened, "azimuth") != 135


def test_everything_that_acts_has_a_name(opened):
    tree = opened.send("Accessibility.getFullAXTree")["nodes"]
    acting = {"button", "slider", "spinbutton", "combobox", "tab", "checkbox", "application", "img"}
    for node in tree:
        if node.get("role", {}).get("value") in acting and not node.get("ignored"):
            assert node.get("name", {}).get("value"), node


@pytest.mark.parametrize(
    ("size", "phone", "dark"), [(DESK, False, False), (DESK, False, True), (PHONE, True, False)]
)
def test_nothing_sticks_out(browser, fit, tmp_path, size, phone, dark):
    open_page(browser, tmp_path / "page.html", fit.page(), size=size, phone=phone, dark=dark)
    for tab in ("light", "maps", "shape", "compare"):
        press(browser, f"tab-{tab}")
        assert browser.evaluate("document.documentElement.scrollWidth") <= size[0]
    browser.screenshot(tmp_path / "seen.png")
    assert (tmp_path / "seen.png").stat().st_size > 20_000
    background = browser.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (max(map(int, background[4:-1].split(","))) < 60) == dark


def test_print_is_a_few_pages(opened, tmp_path):
    opened.print_pdf(tmp_path / "report.pdf")
    pdf = (tmp_path / "report.pdf").read_bytes()
    assert 1 <= pdf.count(b"/Type /Page\n") <= 6
    assert opened.messages == []


def test_hostile_texts_do_nothing(browser, fit, tmp_path):
    open_page(
        browser,
        tmp_path / "page.html",
        fit.page(events=HOSTILE, warnings=[HOSTILE], model={HOSTILE: HOSTILE}),
    )
    assert browser.evaluate("window.hacked") is None
    assert browser.evaluate("document.scripts.length") == 2


def test_a_page_without_depth_and_signals(browser, fit, tmp_path):
    open_page(browser, tmp_path / "page.html", page(fit.maps, fit.summary))
    for tab in ("maps", "shape", "compare", "light"):
        press(browser, f"tab-{tab}")
    assert browser.evaluate("document.getElementById('distance').disabled")
    assert browser.evaluate("document.getElementById('signals-figure').hidden")
    assert browser.messages == []


def test_a_page_of_nothing_known(browser, fit, tmp_path):
    nothing = np.zeros_like(fit.maps.mask)
    open_page(
        browser,
        tmp_path / "page.html",
        page(replace(fit.maps, mask=nothing, mask_reflectance=nothing), fit.summary),
    )
    for tab in ("maps", "shape", "compare", "light"):
        press(browser, f"tab-{tab}")
    assert browser.messages == []
