"""Lay the figures out as tables, for the terminal."""

import numpy as np
from rich.table import Table

HEADINGS = {
    "events": ("events", "{:.0f}"),
    "angle_known": ("known", "{:.0%}"),
    "angle": ("angle", "{:.2f}"),
    "angle_bound": ("limit", "{:.2f}"),
    "angle_told": ("told", "{:.2f}"),
    "angle_ratio": ("ratio", "{:.2f}"),
    "angle_typical": ("typ.", "{:.2f}"),
    "reflectance_known": ("known", "{:.0%}"),
    "reflectance": ("refl.", "{:.4f}"),
    "reflectance_bound": ("limit", "{:.4f}"),
    "reflectance_told": ("told", "{:.4f}"),
    "reflectance_ratio": ("ratio", "{:.2f}"),
    "reflectance_typical": ("typ.", "{:.2f}"),
    "mae_deg": ("MAE", "{:.2f}"),
    "rmse": ("RMSE", "{:.4f}"),
    "sam_deg": ("SAM", "{:.2f}"),
}


def _table(title: str, left: tuple[str, ...], right: tuple[str, ...]) -> Table:
    out = Table(title=title, title_justify="left", box=None, padding=(0, 1, 0, 0))
    for heading in left:
        out.add_column(heading, no_wrap=True)
    for heading in right:
        out.add_column(heading, justify="right", no_wrap=True, min_width=6)
    return out


def _text(value, form: str) -> str:
    return "-" if value is None else form.format(value)


def case_table(title: str, label: str, rows: list[dict]) -> Table:
    """Show errors, limits and ratios; `label` names the entry that tells the rows apart."""
    out = _table(title, (label, "priors"), tuple(heading for heading, _ in HEADINGS.values()))
    for row in rows:
        first = row[label] if isinstance(row[label], str) else f"{row[label]:g}"
        figures = (_text(row[key], form) for key, (_, form) in HEADINGS.items())
        out.add_row(first, "on" if row["priors"] else "none", *figures)
    return out


def ratio_table(rows: list[dict]) -> Table:
    """Show the medians over scenes of error / limit."""
    keys = ("angle_ratio", "angle_typical", "reflectance_ratio", "reflectance_typical")
    out = _table(
        "Base case: median over scenes of error / limit",
        ("sensor", "preset", "priors"),
        ("angle", "typ.", "refl.", "typ."),
    )
    for row in rows:
        ratios = (f"{row[key]:.2f}" for key in keys)
        out.add_row(row["sensor"], row["preset"], "on" if row["priors"] else "none", *ratios)
    return out


def own_table(rows: list[dict]) -> Table:
    """Show means over the recordings of each scene of error / limit, with their standard errors."""
    keys = ("angle_ratio", "angle_typical", "reflectance_ratio", "reflectance_typical")
    out = _table("The model's own light: error / limit", ("scene",), ("angle", "typ.", "refl.", "typ."))
    for name in dict.fromkeys(row["scene"] for row in rows):
        some = np.array([[row[key] for key in keys] for row in rows if row["scene"] == name])
        error = some.std(axis=0, ddof=1) / np.sqrt(len(some)) if len(some) > 1 else [np.nan] * len(keys)
        out.add_row(name, *(f"{mean:.3f} +- {e:.3f}" for mean, e in zip(some.mean(axis=0), error)))
    return out


def calibration_table(rows: list[dict]) -> Table:
    """Show how many pixels lie within one and two sigma."""
    out = _table(
        "Pixels within 1 and 2 sigma [%] (wanted: 68 and 95; angle of a 2-D Gaussian: 63 and 98)",
        ("scene", "sensor", "preset", "priors"),
        ("known", "angle 1", "angle 2", "refl. 1", "refl. 2"),
    )
    for row in rows:
        if "known" not in row:
            continue
        keys = ("known", "angle_1", "angle_2", "reflectance_1", "reflectance_2")
        shares = (_text(row[key] and 100 * row[key], "{:.0f}") for key in keys)
        left = row["scene"], row["sensor"], row["preset"], "on" if row["priors"] else "none"
        out.add_row(*left, *shares)
    return out


def best_table(rows: list[dict], signal: dict[str, float]) -> Table:
    """Show the best constant light."""
    out = _table(
        "Best constant light, by the error over all pixels",
        ("scene", "priors", "for"),
        ("C_w", "within 10 %", "LED signal", "C_w / LED signal"),
    )
    for row in rows:
        out.add_row(
            row["scene"],
            "on" if row["priors"] else "none",
            row["what"],
            f"{row['best']:.3f}",
            f"{row['low']:.3f}-{row['high']:.3f}",
            f"{signal[row['scene']]:.3f}",
            f"{row['relative']:.2f}",
        )
    return out


def markdown(rows: list[dict]) -> str:
    """Write all swept cases as one table per quantity, a row per setting and a column per scene.

    A cell holds the error of each pixel alone, that with priors, the limit, and the ratio of the first to it.
    """
    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    case = {(row["parameter"], row["value"], row["scene"], row["priors"]): row for row in rows}
    settings = list(dict.fromkeys((row["parameter"], row["value"]) for row in rows))
    out = []
    for title, key in (("normals [deg]", "angle"), ("reflectance", "reflectance")):
        error, ratio = HEADINGS[key][1], HEADINGS[f"{key}_ratio"][1]
        out += [f"| {title} | {' | '.join(scenes)} |", "|---" * (1 + len(scenes)) + "|"]
        for parameter, value in settings:
            cells = []
            for name in scenes:
                alone, helped = (case.get((parameter, value, name, priors), {}) for priors in (False, True))
                shown = (alone.get(key), error), (helped.get(key), error), (alone.get(f"{key}_bound"), error)
                parts = [_text(*pair) for pair in (*shown, (alone.get(f"{key}_ratio"), ratio))]
                cells.append(" · ".join(parts))
            out.append(f"| {parameter} {value:g} | {' | '.join(cells)} |")
        out.append("")
    return "\n".join(out)
