"""The page of `evsdr.view`: one file that loads nothing else, with the style and the helpers of `report.html`."""

from datetime import datetime
from html import escape
from pathlib import Path

from evsdr import __version__
from evsdr.page import document as report
from evsdr.viewing import words
from evsdr.viewing.check import Check, verdict
from evsdr.viewing.contents import MOST_EVENTS, contents
from evsdr.viewing.look import Look

HERE = Path(__file__).parent
SHARED = "decode", "colour", "maps", "charts", "pixel", "stage", "sheet"  # of the report
OWN = "lines", "watched", "view"


def page(
    look: Look,
    checks: list[Check],
    command: str = "",
    written: str | None = None,
    most_events: int = MOST_EVENTS,
) -> str:
    """Give the page.

    Parameters
    ----------
    look : Look
    checks : list of Check
        Of `checks.examine`.
    command : str
        What made it.
    written : str, optional
        When; now by default.
    most_events : int
        That it holds.
    """
    written = written or datetime.now().astimezone().strftime("%Y-%m-%d %H:%M")
    title, word = look.watched.path.name, verdict(checks)
    parts = {
        "kind": "view",
        "title": escape(title),
        "subtitle": words.subtitle(look, written, __version__),
        "verdict": words.verdict(word, look, checks),
        "figures": words.key_figures(look),
        "checks": words.check_list(checks),
        "record": words.record(look, command, __version__),
    }
    styles = report.HERE / "style.css", HERE / "view.css"
    scripts = *(report.HERE / f"{name}.js" for name in SHARED), *(HERE / f"{name}.js" for name in OWN)
    return report.assemble(
        HERE / "view.html", styles, scripts, parts, contents(look, most_events) | {"title": title}
    )
