"""`python -m experiments.table1`: the table of the EventSpecPS paper, with recordings made in kind."""

import argparse
import json
import sys
from pathlib import Path

import numpy as np

from evsdr import InputError, jit

from .cases import BASES, N_LED, N_STATE, REPOSITORY, list_cases
from .recordings import checksums, make

OUT = REPOSITORY / "out" / "table1"
PAPER_METHOD = {  # whose figures stand beside ours
    "EventSpecPS, its decoder": "EventSpecPS",
    "two stages": "two stages",
    "frames, Guo et al.": "Guo",
    "frames, Fyffe et al.": "Fyffe",
}
PAPER = {  # its table 1: angle [deg], SAM [deg], RMSE, MiB
    ("blobs", 1, "two stages"): (9.61, 9.10, 0.0302, 13.31),
    ("blobs", 1, "Guo"): (16.01, 7.58, 0.0402, 16),
    ("blobs", 1, "Fyffe"): (20.62, 13.49, 0.0591, 16),
    ("blobs", 1, "EventSpecPS"): (5.89, 2.65, 0.0164, 12.66),
    ("sculptures", 1, "two stages"): (18.39, 10.55, 0.0383, 7.53),
    ("sculptures", 1, "Guo"): (21.96, 15.28, 0.0755, 16),
    ("sculptures", 1, "Fyffe"): (27.41, 21.07, 0.1056, 16),
    ("sculptures", 1, "EventSpecPS"): (12.22, 3.11, 0.0171, 7.26),
    ("blobs", 3, "two stages"): (9.62, 10.52, 0.0633, 13.31),
    ("blobs", 3, "Guo"): (22.65, 19.71, 0.0886, 16),
    ("blobs", 3, "Fyffe"): (27.58, 25.21, 0.1058, 16),
    ("blobs", 3, "EventSpecPS"): (8.16, 5.78, 0.0394, 12.80),
    ("sculptures", 3, "two stages"): (18.38, 10.13, 0.0576, 7.05),
    ("sculptures", 3, "Guo"): (28.44, 26.50, 0.1225, 16),
    ("sculptures", 3, "Fyffe"): (33.06, 32.53, 0.1428, 16),
    ("sculptures", 3, "EventSpecPS"): (13.5, 7.42, 0.0452, 7.16),
    ("blobs", 8, "two stages"): (9.61, 10.36, 0.0663, 13.31),
    ("blobs", 8, "Guo"): (24.07, 22.05, 0.1017, 16),
    ("blobs", 8, "Fyffe"): (28.73, 27.28, 0.1182, 16),
    ("blobs", 8, "EventSpecPS"): (9.38, 7.41, 0.0471, 13.17),
    ("sculptures", 8, "two stages"): (18.41, 10.61, 0.0633, 6.93),
    ("sculptures", 8, "Guo"): (29.25, 27.99, 0.1289, 16),
    ("sculptures", 8, "Fyffe"): (34.02, 34.14, 0.1527, 16),
    ("sculptures", 8, "EventSpecPS"): (14.6, 9.09, 0.0541, 7.00),
}
PAPERS_RING = (
    "two stages",
    "frames, Guo et al.",
    "frames, Fyffe et al.",
)  # whose light is made of its 24 LEDs
COLUMNS = ("mae_deg", "sam_deg", "rmse", "scaled_rmse", "mib")
HEAD = """| bases | objects | method | angle | median | SAM | RMSE | scaled | MiB | CPU s | paper: angle | SAM | RMSE | MiB |
|---|---|---|---|---|---|---|---|---|---|---|---|---|---|"""


def main(argv: list[str] | None = None) -> int:
    """Make the recordings that are missing, apply the methods, print the table; what is done already is kept."""
    from .methods import METHODS  # late: it is slow to import

    parser = argparse.ArgumentParser(prog="table1", description=__doc__)
    parser.add_argument("--size", type=int, default=64, help="width and height [pixels]; the paper's are 256")
    parser.add_argument("--objects", type=int, help="of each kind; all ten by default")
    parser.add_argument("--bases", type=int, nargs="+", default=BASES, help="spectral bases of the textures")
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=list(METHODS), metavar="METHOD")
    parser.add_argument(
        "--rainbow",
        action="store_true",
        help="96 colours of a continuous circle for the 24 LEDs; for the first four",
    )
    parser.add_argument("--pixel", choices=("paper", "ours"), default="paper", help="who makes the events")
    parser.add_argument("--make-only", action="store_true", help="make the recordings and their checksums")
    parser.add_argument("--out", type=Path, help="folder; by default one in out/table1")
    options = parser.parse_args(argv)
    folder = options.out or OUT / f"{options.pixel}_{options.size}"
    used = [name for name in options.methods if not options.rainbow or name not in PAPERS_RING]
    try:
        jit.start()
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    given = options.objects, tuple(options.bases), N_STATE if options.rainbow else N_LED
    cases = sorted(list_cases(*given), key=lambda case: case.number)
    for i, case in enumerate(cases):
        print(f"{i + 1}/{len(cases)} {case.name}", file=sys.stderr, flush=True)
        if not (folder / case.name / "case.json").is_file():
            make(case, folder / case.name, options.size, options.pixel)
        if not options.make_only:
            apply(used, folder / case.name)
    (folder / "SHA256SUMS").write_text(checksums(folder))
    print(HEAD)
    for n_basis in options.bases:
        for dataset in ("blobs", "sculptures"):
            names = [c.name for c in cases if (c.dataset, c.bases) == (dataset, n_basis)]
            for method in used:
                print_row(
                    dataset, n_basis, method, [read_scores(folder / name).get(method) for name in names]
                )
    return 0


def apply(methods: list[str], folder: Path) -> None:
    """Apply the methods that have not been applied, and keep their scores."""
    from .methods import run

    scores = read_scores(folder)
    for method in methods:
        if method not in scores:
            scores[method] = run(method, folder)
            (folder / "scores.json").write_text(json.dumps(scores, indent=1) + "\n")


def read_scores(folder: Path) -> dict:
    """Read what has been scored already."""
    file = folder / "scores.json"
    return json.loads(file.read_text()) if file.is_file() else {}


def print_row(dataset: str, n_basis: int, method: str, scores: list[dict | None]) -> None:
    """Print the means of a method over the objects, and beside them the paper's."""
    scores = [score for score in scores if score]
    if not scores:
        return
    median = np.median([score["mae_deg"] for score in scores])
    angle, sam, rmse, scaled, mib, seconds = (
        np.mean([s[name] for s in scores]) for name in (*COLUMNS, "seconds")
    )
    paper = PAPER.get((dataset, n_basis, PAPER_METHOD.get(method)))
    beside = " | ".join(f"{value:g}" for value in paper) if paper else " | | |"
    own = f"{angle:.2f} | {median:.2f} | {sam:.2f} | {rmse:.4f} | {scaled:.4f} | {mib:.1f} | {seconds:.0f}"
    print(f"| {n_basis} | {len(scores)} {dataset} | {method} | {own} | {beside} |")


if __name__ == "__main__":
    sys.exit(main())
