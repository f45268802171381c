"""What a page says in words: HTML of verdict, key figures and the record of a fit. All text is escaped."""

from collections.abc import Iterable
from html import escape
from pathlib import PurePath

import numpy as np

from evsdr.records import Maps

MEANING = {
    "trustworthy": "Nothing in the recording contradicts these results.",
    "doubtful": "The results stand, but something should be looked into.",
    "contradicted": "The recording contradicts the files it was fitted with.",
}
NUMBERS = {
    "events": "events on the object",
    "pairs": "pairs of events that were explained",
    "pairs_dropped": "pairs left out",
    "pixels_solved": "pixels solved",
    "pixels_known": "pixels whose normal is known",
    "pixels_of_known_scale": "pixels whose scale is known",
    "steps": "steps of the solver",
}
ERRORS = {
    "mae_deg": ("mean angle to the true normals", "°"),
    "median_deg": ("median angle to the true normals", "°"),
    "sam_deg": ("mean spectral angle", "°"),
    "rmse": ("root mean square error of reflectance", ""),
}


def title_of(summary: dict) -> str:
    """Name the page after the recording."""
    path = PurePath(str(summary.get("events") or "a recording"))
    name = path.stem if path.suffix == ".h5" else path.name
    return f"{path.parent.name} / {name}" if path.parent.name and name == "events" else name


def subtitle(summary: dict, maps: Maps, written: str) -> str:
    """Say what was fitted, when, by what."""
    height, width = maps.mask.shape
    nm = np.sort(maps.band_wavelength_nm)
    bands = f"{len(nm)} bands, {nm[0]:.0f} to {nm[-1]:.0f} nm" if len(nm) > 1 else f"one band, {nm[0]:.0f} nm"
    parts = [f"{width} × {height} pixels", bands, f"written {written}", f"evsdr {summary.get('evsdr', '')}"]
    return escape(" · ".join(parts))


def verdict(summary: dict) -> str:
    """Write the verdict, its reasons, and warnings that are not among them."""
    word, _, reasons = str(summary.get("verdict", "")).partition(": ")
    known = word if word in MEANING else "doubtful"
    more = [text for text in summary.get("warnings", ()) if str(text) not in reasons]
    items = [reasons] * bool(reasons) + list(more)
    rows = "".join(f"<li>{escape(str(text))}</li>" for text in items)
    listed = f'<ul class="reasons">{rows}</ul>' if rows else ""
    return (
        f'<div class="verdict {known}"><p><strong class="word">{escape(word or "no verdict")}</strong> '
        f"<span>{MEANING[known]}</span></p>{listed}</div>"
    )


def key_figures(summary: dict, maps: Maps) -> str:
    """Write the numbers that everybody asks for."""
    known, scaled = maps.mask, maps.mask_reflectance
    total = summary.get("numbers", {}).get("pixels_solved", int(np.count_nonzero(known)))
    figures = [(f"{np.count_nonzero(known):,}", f"pixels known, of {total:,}")]
    if known.any():
        figures.append(
            (f"{np.median(maps.normal_sigma_deg[known]):.2g}°", "typical uncertainty of normals (1 σ)")
        )
    if scaled.any():
        figures.append(
            (f"{np.median(maps.reflectance_sigma[scaled]):.2g}", "typical uncertainty of reflectance (1 σ)")
        )
    for name, value in summary.get("error", {}).items():
        if name in ("mae_deg", "rmse"):
            figures.append((f"{value:.3g}{ERRORS[name][1]}", ERRORS[name][0]))
    if summary.get("seconds"):
        figures.append((f"{sum(summary['seconds'].values()):.0f} s", "of computing"))
    cards = "".join(f"<div><dd>{escape(v)}</dd><dt>{escape(what)}</dt></div>" for v, what in figures)
    return f'<dl class="figures">{cards}</dl>'


def record(summary: dict) -> str:
    """Write how the result was made: what was modelled and why, numbers, seconds, and how to make it again."""
    parts = [
        ("What was modelled, and why", model(summary)),
        ("Errors against the truth", errors(summary)),
        ("Numbers", counted(summary)),
        ("Where events are explained less well", paragraph(summary.get("misfit"))),
        ("Sensor", sensor(summary)),
        ("Seconds", seconds(summary)),
        ("How to make it again", again(summary)),
    ]
    return "".join(f"<section><h3>{name}</h3>{text}</section>" for name, text in parts if text)


def model(summary: dict) -> str:
    """Write what was decided on each effect."""
    effects, rows = summary.get("effects", {}), []
    for name, why in summary.get("model", {}).items():
        decided = effects.get(name)
        said = "" if decided is None else "modelled" if decided.get("modelled") else "not modelled"
        rows.append((name, said, why))
    return table(("effect", "decision", "why"), rows, "wide")


def errors(summary: dict) -> str:
    """Write the errors, where truth was given."""
    found = summary.get("error", {}).items()
    return table(
        ("measure", "value"), [(*ERRORS[k][:1], f"{v:.4g}{ERRORS[k][1]}") for k, v in found if k in ERRORS]
    )


def counted(summary: dict) -> str:
    """Write how many events and pixels there were, and what is left of the events."""
    rows = [(NUMBERS.get(name, name), f"{value:,}") for name, value in summary.get("numbers", {}).items()]
    noise = summary.get("residual", {}).get("relative_threshold_noise")
    rows += (
        [("scatter of a threshold that the maps leave unexplained", f"{noise:.1%}")]
        if noise is not None
        else []
    )
    result = summary.get("convergence", {}).get("result")
    return table(("what", "number"), rows + ([("the solver", result)] if result else []))


def sensor(summary: dict) -> str:
    """Write what was found of the sensor."""
    rows = []
    for name, found in summary.get("sensor", {}).items():
        values = found.items() if isinstance(found, dict) else [("", found)]
        words = name.removesuffix("_us").replace("_", " ") + (" period" if name == "refractory_us" else "")
        for what, value in values:
            unit = " µs" if (what or name).endswith("_us") else ""
            rows.append((f"{words} {what.removesuffix('_us')}".strip(), number(value) + unit))
    return table(("of the sensor", "value"), rows)


def seconds(summary: dict) -> str:
    """Write the seconds of each stage."""
    spent = summary.get("seconds", {})
    rows = [(name, f"{value:.2f}") for name, value in spent.items()]
    return table(("stage", "seconds"), rows + [("all", f"{sum(spent.values()):.2f}")] * bool(rows))


def again(summary: dict) -> str:
    """Write command, version, files."""
    rows = [
        ("command", summary.get("command", "from Python, by evsdr.fit")),
        ("version", f"evsdr {summary.get('evsdr', '')}"),
        *((name, summary[name]) for name in ("scene", "events", "solver", "preset") if name in summary),
    ]
    return table(("", ""), [(name, str(value)) for name, value in rows], "code")


def table(head: tuple[str, ...], rows: Iterable[tuple], kind: str = "") -> str:
    """Write a table; the first cell of a row names it."""
    body = "".join(
        f'<tr><th scope="row">{escape(str(first))}</th>'
        + "".join(f"<td>{escape(str(cell))}</td>" for cell in rest)
        + "</tr>"
        for first, *rest in rows
    )
    names = "".join(f'<th scope="col">{escape(name)}</th>' for name in head)
    header = f"<thead><tr>{names}</tr></thead>" if any(head) else ""
    return f'<table class="{kind}">{header}<tbody>{body}</tbody></table>' if body else ""


def paragraph(text: object) -> str:
    """Write a sentence, if there is one."""
    return f"<p>{escape(str(text))}</p>" if text else ""


def number(value: object) -> str:
    """Write a number in few digits, or what else it is."""
    return f"{value:.4g}" if isinstance(value, float | np.floating) else str(value)
