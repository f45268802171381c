"""The words of the page: every check, its state, and nothing unescaped."""

from evsdr.viewing import words
from evsdr.viewing.check import DOUBTFUL, FINE, WRONG, Check
from evsdr.viewing.look import look_at
from tests.support.watched_files import recorded, watched

CHECKS = [
    Check("LEDs", FINE, "All 24 give light"),
    Check("room light", DOUBTFUL, "There is <some>", "switch it off"),
    Check("scene", WRONG, "Mirrored", "turn it"),
]


def test_only_what_is_odd_speaks_for_the_verdict():
    look = look_at(watched(recorded()))
    text = words.verdict("contradicted", look, CHECKS)
    assert text.count("<li>") == 2 and "All 24" not in text
    assert "There is &lt;some&gt;: switch it off." in text
    table = words.check_list(CHECKS)
    assert table.count("<tr class=") == 3
    assert '<strong class="remedy">Switch it off.</strong>' in table and "<some>" not in table


def test_figures_and_record_tell_the_recording():
    look = look_at(watched(recorded()))
    assert f"<dd>{len(look.watched.events):,}</dd><dt>events</dt>" in words.key_figures(look)
    text = words.record(look, "python -m evsdr.view x", "0.1")
    assert "0 1 2 3 4 5 6 7 8 9 10 11" in text and "python -m evsdr.view x" in text and "20 ms" in text
