"""`python -m experiments.extremes`: fits far from what is usual: errors, sigmas, and what is said."""

import argparse
import json
from dataclasses import asdict
from pathlib import Path

from .compute import Result, child, run

HEAD = (
    "| what | value | events a pixel | known | angle [deg] | sigma [deg] | within 3 | scale known | reflectance | within 3 "
    "| seconds | verdict |"
)


def main(argv: list[str] | None = None) -> None:
    """Run the cases; print a table in Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--groups", nargs="+", help="what is extreme; by default all")
    parser.add_argument("--large", action="store_true", help="the sensor's full frame, too")
    parser.add_argument("--json", type=Path, help="write all results, with what the verdicts say")
    parser.add_argument("--child", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args(argv)
    if options.child is not None:
        child(options.child, options.groups, options.large)
        return
    print(HEAD, "|---" * HEAD.count(" | ") + "|---|", sep="\n", flush=True)
    results = []
    for result in run(options.groups, options.large):
        results.append(result)
        print(line(result), flush=True)
    if options.json:
        options.json.write_text(json.dumps([asdict(result) for result in results], indent=1))


def line(result: Result) -> str:
    """Lay a result out."""

    def number(value: float | None, form: str) -> str:
        return "" if value is None else format(value, form)

    verdict = result.state if result.events else f"{result.state}: {result.said}"
    cells = (
        result.group,
        result.value,
        number(result.events or None, ".3g"),
        number(result.known, ".0%") if result.events else "",
        number(result.mae_deg, ".2g"),
        number(result.sigma_deg, ".2g"),
        number(result.within, ".0%"),
        number(result.scaled, ".0%") if result.events else "",
        number(result.reflectance, ".1%"),
        number(result.reflectance_within, ".0%"),
        number(result.seconds, ".1f"),
        verdict,
    )
    return f"| {' | '.join(cells)} |"


if __name__ == "__main__":
    main()
