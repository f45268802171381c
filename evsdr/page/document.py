"""The page itself: template, style, scripts and contents in one file that loads nothing else.

Its content security policy names style and script by their hashes, so that a browser runs nothing else, and fetches
nothing, whatever the texts of a recording hold.
"""

import base64
import hashlib
import json
import re
from datetime import datetime
from html import escape
from pathlib import Path

from evsdr.page import words
from evsdr.page.contents import MOST_BYTES, contents
from evsdr.records import Maps, Signals, Truth
from evsdr.shape.depth import Depth

HERE = Path(__file__).parent
SCRIPTS = (
    "decode",
    "npz",
    "colour",
    "maps",
    "relight",
    "mesh",
    "charts",
    "pixel",
    "compare",
    "stage",
    "sheet",
    "main",
)


def write_report(
    path: Path,
    maps: Maps,
    summary: dict,
    signals: Signals | None = None,
    depth: Depth | None = None,
    truth: Truth | None = None,
) -> None:
    """Write the page of a fit; arguments as those of `page`."""
    written = datetime.now().astimezone().strftime("%Y-%m-%d %H:%M")
    path.write_text(page(maps, summary, signals, depth, truth, written), encoding="utf-8")


def page(
    maps: Maps,
    summary: dict,
    signals: Signals | None = None,
    depth: Depth | None = None,
    truth: Truth | None = None,
    written: str = "",
    most_bytes: int = MOST_BYTES,
) -> str:
    """Give the page of a fit.

    Parameters
    ----------
    maps : Maps
    summary : dict
        As in `summary.json`.
    signals : Signals, optional
        Light of each LED, as the maps have it and as events tell it.
    depth : Depth, optional
        Of the pixels solved.
    truth : Truth, optional
        What is true.
    written : str
        When.
    most_bytes : int
        Of all arrays in it.
    """
    shown = contents(maps, signals, depth, truth, most_bytes) | {"title": words.title_of(summary)}
    parts = {
        "kind": "report",
        "title": escape(shown["title"]),
        "subtitle": words.subtitle(summary, maps, written),
        "verdict": words.verdict(summary),
        "figures": words.key_figures(summary, maps),
        "record": words.record(summary),
    }
    files = (HERE / "style.css",), tuple(HERE / f"{name}.js" for name in SCRIPTS)
    return assemble(HERE / "page.html", *files, parts, shown)


def assemble(
    template: Path,
    styles: tuple[Path, ...],
    scripts: tuple[Path, ...],
    parts: dict[str, str],
    shown: dict,
    connect: str = "",
) -> str:
    """Put a page together.

    Parameters
    ----------
    template : Path
        Its body.
    styles, scripts : tuple of Path
    parts : dict
        What stands for the names in the template, in HTML; with `title` and `kind`, which are those of the page.
    shown : dict
        What the scripts read.
    connect : str
        Where they may connect.
    """
    style = "".join(path.read_text(encoding="utf-8") for path in styles)
    script = "\n".join(path.read_text(encoding="utf-8") for path in scripts)
    script = f'"use strict";\n(() => {{\n{script}}})();\n'
    parts = parts | {
        "policy": policy(style, script, connect),
        "style": style,
        "script": script,
        "contents": in_script(shown),
    }
    frame, body = (path.read_text(encoding="utf-8") for path in (HERE / "frame.html", template))
    return re.sub(r"\{\{(\w+)\}\}", lambda name: parts[name[1]], frame.replace("{{body}}", body))


def policy(style: str, script: str, connect: str = "") -> str:
    """Allow this style and this script, and nothing from anywhere else than an address to connect to."""
    allowed = (
        f"default-src 'none'; img-src data: blob:; style-src {digest(style)}; script-src {digest(script)}"
    )
    return allowed + (f"; connect-src {connect}" if connect else "")


def digest(text: str) -> str:
    """Name a text by its hash, as a content security policy does."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode('utf-8')).digest()).decode('ascii')}'"


def in_script(values: dict) -> str:
    """Write JSON that may stand in a script element: no text in it ends the element."""
    text = json.dumps(values, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")
