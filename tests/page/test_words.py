"""What a page says in words."""

import re

import numpy as np
import pytest

from evsdr.page import words
from tests.support.page_fits import HOSTILE, SUMMARY, make_fit


def text_of(html):
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", html))


@pytest.mark.parametrize(
    ("events", "title"),
    [
        ("out/vase.h5", "vase"),
        ("out/vase/events.h5", "vase / events"),
        ("the recording", "the recording"),
        ("", "a recording"),
    ],
)
def test_title(events, title):
    assert words.title_of({"events": events}) == title


def test_what_was_found_of_the_sensor_has_units():
    found = {"refractory_us": {"told_us": 52.0, "found_us": 65.2}, "contrast_threshold_on": {"told": 0.25}}
    html = text_of(words.sensor({"sensor": found}))
    for said in ("refractory period told 52 µs", "period found 65.2 µs", "contrast threshold on told 0.25 "):
        assert said in html


@pytest.mark.parametrize("word", ["trustworthy", "doubtful", "contradicted"])
def test_verdict_names_its_word_and_each_reason_once(word):
    html = words.verdict({"verdict": f"{word}: One. Two.", "warnings": ["Two.", "Three."]})
    assert f'class="verdict {word}"' in html and f">{word}</strong>" in html
    assert text_of(html).count("Two.") == 1 and "Three." in html


def test_key_figures():
    fit = make_fit()
    html = text_of(words.key_figures(SUMMARY, fit.maps))
    assert f"{np.count_nonzero(fit.maps.mask)} pixels known, of 120" in html
    assert f"{np.median(fit.maps.normal_sigma_deg[fit.maps.mask]):.2g}°" in html
    assert "1.25° mean angle" in html and "2 s of computing" in html


def test_record_holds_all_that_the_summary_says():
    html = text_of(words.record(SUMMARY))
    for said in (
        "cast shadows not modelled left out: none",
        "12,345",
        "4.2%",
        "settled",
        "0.2512",
        "much alike everywhere",
    ):
        assert said in html
    for said in (
        "mean angle to the true normals 1.25°",
        "all 2.50",
        "python -m evsdr.fit scene.xml vase.h5",
        "evsdr 0.1.0",
    ):
        assert said in html


def test_a_fit_from_python_has_no_command():
    assert "from Python" in words.again({})


def test_an_empty_summary_says_little():
    assert "no verdict" in words.verdict({}) and "How to make it again" in words.record({})


def test_all_texts_are_escaped():
    spoilt = {
        "evsdr": HOSTILE,
        "events": HOSTILE,
        "scene": HOSTILE,
        "command": HOSTILE,
        "misfit": HOSTILE,
        "verdict": f"doubtful: {HOSTILE}",
        "warnings": [HOSTILE, "x" + HOSTILE],
        "model": {HOSTILE: HOSTILE},
        "sensor": {HOSTILE: {HOSTILE: HOSTILE}, "a": HOSTILE},
        "seconds": {HOSTILE: 1.0},
        "convergence": {"result": HOSTILE},
    }
    maps = make_fit().maps
    html = words.verdict(spoilt) + words.record(spoilt) + words.subtitle(spoilt, maps, HOSTILE)
    assert not re.search(r"<(script|img)", html, re.IGNORECASE)
