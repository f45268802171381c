"""The page as a file: well-formed, of one piece, of bounded size, and no text of a recording does anything in it."""

import json
import re
import time
from html.parser import HTMLParser

import numpy as np
import pytest

from evsdr.page import document
from evsdr.page.document import HERE, SCRIPTS, digest, in_script, write_report
from tests.support.page_fits import HOSTILE, make_fit

VOID = {"meta", "input", "img", "br", "link"}


class Reader(HTMLParser):
    """Checks that elements nest, and collects them."""

    def __init__(self, text):
        super().__init__()
        self.open, self.elements, self.texts = [], [], {}
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attributes):
        self.elements.append((tag, dict(attributes)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.texts.setdefault(self.open[-1] if self.open else "", []).append(data)


@pytest.fixture(scope="module")
def fit():
    return make_fit()


@pytest.fixture(scope="module")
def read(fit):
    return Reader(fit.page())


def test_page_is_well_formed(read):
    names = [attributes["id"] for _, attributes in read.elements if "id" in attributes]
    assert len(names) == len(set(names)) > 30
    assert read.elements[0][0] == "html" and ("main", {}) in read.elements


def test_page_loads_nothing(fit, read):
    for _, attributes in read.elements:
        for name in ("src", "srcset", "data", "action", "poster"):
            assert name not in attributes
        assert attributes.get("href", "#").startswith(("#", "data:"))
    without_namespace = fit.page().replace("http://www.w3.org/2000/svg", "")
    assert not re.search(r"https?://|//cdn|@import|url\(", without_namespace)


def test_policy_names_style_and_scripts_of_the_page(read):
    policy = next(
        a["content"] for tag, a in read.elements if a.get("http-equiv") == "Content-Security-Policy"
    )
    (style,), scripts = read.texts["style"], read.texts["script"]
    assert (
        policy.startswith("default-src 'none'") and digest(style) in policy and digest(scripts[-1]) in policy
    )
    assert "unsafe" not in policy


def test_no_style_stands_in_an_attribute(read):
    """The policy would refuse it."""
    assert not any(
        "style" in attributes or any(a.startswith("on") for a in attributes)
        for _, attributes in read.elements
    )


def test_labels_lead_to_what_there_is(read):
    names = {attributes["id"] for _, attributes in read.elements if "id" in attributes}
    for _, attributes in read.elements:
        for key in ("aria-labelledby", "aria-controls", "aria-describedby", "for"):
            assert attributes.get(key, "frame") in names
    inside = [(tag, a) for tag, a in read.elements if tag in ("canvas", "frame") and "tabindex" in a]
    assert all("aria-label" in a for _, a in inside)


def test_scripts_ask_for_elements_that_there_are(read):
    names = {attributes["id"] for _, attributes in read.elements if "id" in attributes}
    asked = set(re.findall(r'(?:byId|getElementById|place)\("([\w-]+)"', read.texts["script"][-1]))
    assert asked - {"-"} <= names and len(asked) > 30


def test_every_script_is_in_the_page():
    assert {path.stem for path in HERE.glob("*.js")} == set(SCRIPTS)


def test_contents_are_json_without_nan(read):
    held = json.loads(read.texts["script"][0], parse_constant=pytest.fail)
    assert held["title"] == "vase" and held["left_out"] == []


def test_hostile_texts_do_nothing(fit):
    text = fit.page(events=HOSTILE, warnings=[HOSTILE], model={HOSTILE: HOSTILE}, command=HOSTILE)
    read, plain = Reader(text), Reader(fit.page())
    assert [tag for tag, _ in read.elements if tag in ("script", "img")] == ["script", "script"]
    assert json.loads(read.texts["script"][0])["title"] == HOSTILE.split("/")[-1] or HOSTILE[:9] in text
    assert read.texts["style"] == plain.texts["style"]
    assert read.texts["script"][1] == plain.texts["script"][1]


def test_json_in_a_script_ends_nothing():
    text = in_script({"a": HOSTILE})
    assert "<" not in text and "\u2028" not in text
    assert json.loads(text) == {"a": HOSTILE}
    with pytest.raises(ValueError):
        in_script({"a": float("nan")})


def test_size_and_seconds(tmp_path):
    """256 x 256 pixels with 8 bands, all of it noise: real maps compress better."""
    fit = make_fit(1, 256, 256, np.linspace(400, 700, 8))
    begin = time.perf_counter()
    write_report(tmp_path / "report.html", fit.maps, fit.summary, fit.signals, fit.depth, fit.truth)
    assert (tmp_path / "report.html").stat().st_size < 10e6
    assert time.perf_counter() - begin < 20


def test_a_bound_on_the_size_is_kept(fit):
    shown = fit.maps, fit.summary, fit.signals, fit.depth, fit.truth
    whole, small = document.page(*shown), document.page(*shown, most_bytes=4000)
    assert len(small) < len(whole) - 2000
    assert "light" in json.loads(Reader(small).texts["script"][0])["left_out"]


def test_same_fit_gives_the_same_page(fit):
    assert fit.page() == fit.page()
