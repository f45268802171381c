"""The controls of a fit's page, worked as its users work them."""

import json


def press(browser, name):
    browser.evaluate(f"document.getElementById({name!r}).click()")


def put(browser, name, value, event="input"):
    browser.evaluate(
        f"(() => {{ const e = document.getElementById({name!r}); e.value = {json.dumps(value)};"
        f" e.dispatchEvent(new Event({event!r}, {{bubbles: true}})); }})()"
    )


def text(browser, name):
    return browser.evaluate(f"document.getElementById({name!r}).textContent")


def frame_box(browser):
    """Bring the picture into view; gives its left, top, width and height."""
    return browser.evaluate(
        "(() => { const f = document.getElementById('frame'); f.scrollIntoView({block: 'center'});"
        " const b = f.getBoundingClientRect(); return [b.left, b.top, b.width, b.height]; })()"
    )


def drag(browser, start, end):
    """Press at a share of the picture, move, let go."""
    box = frame_box(browser)
    for kind, (x, y) in (("mousePressed", start), ("mouseMoved", end), ("mouseReleased", end)):
        at = {"x": box[0] + x * box[2], "y": box[1] + y * box[3]}
        browser.send("Input.dispatchMouseEvent", type=kind, button="left", buttons=1, clickCount=1, **at)


def key(browser, name):
    for kind in ("keyDown", "keyUp"):
        browser.send("Input.dispatchKeyEvent", type=kind, key=name, code=name)


def value(browser, name):
    return float(browser.evaluate(f"document.getElementById({name!r}).value"))
