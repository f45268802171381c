"""What the page of `evsdr.view` says in words, as HTML. All text is escaped."""

from html import escape

import numpy as np

from evsdr.page.words import table
from evsdr.viewing.check import DOUBTFUL, FINE, OPEN, WRONG, Check
from evsdr.viewing.look import Look

MEANING = {
    "good": "Nothing speaks against this recording.",
    "doubtful": "It can be fitted, but something should be looked into first.",
    "contradicted": "The recording contradicts what is told of it: mend that before you fit it.",
}
UNTOLD = "Nothing speaks against this recording, but without a schedule little can be told."
TONE = {"good": "trustworthy", "doubtful": "doubtful", "contradicted": "contradicted"}
SIGN = {FINE: "✓", DOUBTFUL: "!", WRONG: "✗", OPEN: "–"}
WORD = {FINE: "fine", DOUBTFUL: "look into it", WRONG: "contradicted", OPEN: "not told"}


def meaning(word: str, look: Look) -> str:
    """Say what a verdict means."""
    return UNTOLD if word == "good" and look.rounds is None else MEANING[word]


def verdict(word: str, look: Look, checks: list[Check]) -> str:
    """Write the verdict and what speaks for it."""
    rows = "".join(f"<li>{escape(str(c))}</li>" for c in checks if c.state in (DOUBTFUL, WRONG))
    listed = f'<ul class="reasons">{rows}</ul>' if rows else ""
    return (
        f'<div class="verdict {TONE[word]}"><p><strong class="word">{word}</strong> '
        f"<span>{meaning(word, look)}</span></p>{listed}</div>"
    )


def subtitle(look: Look, written: str, version: str) -> str:
    """Say what was looked at, when, by what."""
    sensor = look.watched.sensor
    parts = [f"{sensor.width} × {sensor.height} pixels", f"{look.watched.seconds:.2f} s"]
    if look.rounds is not None:
        order = np.asarray(look.rounds.schedule.order)
        parts.append(f"{len(order)} slots, {len(np.unique(order[order >= 0]))} LEDs")
    return escape(" · ".join([*parts, f"written {written}", f"evsdr {version}"]))


def key_figures(look: Look) -> str:
    """Write the numbers that everybody asks for."""
    pixels, n = look.pixels, len(look.watched.events)
    count = (pixels.on + pixels.off)[pixels.lit]
    figures = [
        (f"{n:,}", "events"),
        (f"{n / look.watched.seconds / 1e6:.2g} M/s", "events a second"),
        (f"{pixels.lit.mean():.0%}", "of the pixels see the light"),
        (f"{np.median(count) if count.size else 0:.0f}", "events of a lit pixel"),
    ]
    if look.rounds is not None:
        figures += [(f"{look.n_round}", "rounds"), (f"{look.rounds.coherence:.1%}", "agree with their slot")]
    if look.expected is not None:
        figures.append((f"{look.expected.normal_deg:.2g}°", "normals at best (1 σ)"))
    cards = "".join(f"<div><dd>{escape(v)}</dd><dt>{escape(what)}</dt></div>" for v, what in figures)
    return f'<dl class="figures">{cards}</dl>'


def check_list(checks: list[Check]) -> str:
    """Write all questions and their answers."""
    rows = "".join(
        f'<tr class="{c.state.replace(" ", "-")}"><th scope="row">{escape(c.name)}</th>'
        f'<td class="state"><span aria-hidden="true">{SIGN[c.state]}</span> {WORD[c.state]}</td>'
        f"<td>{escape(c.said)}.{remedy(c)}</td></tr>"
        for c in checks
    )
    head = "".join(f'<th scope="col">{name}</th>' for name in ("what", "how it is", "what was found"))
    return f'<table class="wide checks"><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>'


def remedy(check: Check) -> str:
    """Write what to do, if anything."""
    text = check.remedy[:1].upper() + check.remedy[1:]
    return f' <strong class="remedy">{escape(text)}.</strong>' if text else ""


def record(look: Look, command: str, version: str) -> str:
    """Write file, sensor, schedule, and how to make the page again."""
    sensor, rows = look.watched.sensor, []
    told = {
        "contrast_threshold_on": ("contrast threshold ON", ""),
        "contrast_threshold_off": ("contrast threshold OFF", ""),
        "refractory_us": ("refractory period", " µs"),
    }
    for name, (words, unit) in told.items():
        value = np.asarray(getattr(sensor, name))
        of = " (taken for granted)" if name in sensor.guessed else " (mean)" if value.ndim else ""
        rows.append((words, f"{value.mean():.4g}{unit}{of}"))
    if look.rounds is not None:
        plan = look.rounds.schedule
        rows += [
            ("slot", f"{1e-3 * plan.slot_us:.6g} ms"),
            ("crossfade", f"{plan.crossfade:g}"),
            ("order", " ".join(map(str, np.asarray(plan.order).tolist()))),
        ]
    made = [("command", command), ("file", str(look.watched.path)), ("version", f"evsdr {version}")]
    return (
        f"<section><h3>Sensor and schedule</h3>{table(('', ''), rows, 'words')}</section>"
        f"<section><h3>How to make it again</h3>{table(('', ''), made, 'code')}</section>"
    )
