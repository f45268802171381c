"""`python -m experiments.materials`: fits of surfaces that are not matt: errors, sigmas, and what is said."""

import argparse
import tempfile
from pathlib import Path

import evsdr
from evsdr import Settings

from .compute import Result, run
from .scenes import SCENES, cases

HEAD = "| what | known | mean, median [deg] | sigma [deg] | normals within 1, 2, 3 | reflectance within 1, 2, 3 | seconds | verdict |"


def main(argv: list[str] | None = None) -> None:
    """Record and fit each; print a table in Markdown, and what was modelled and said."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--only", nargs="+", help='what a name must begin with, as "sphere, copper"; by default all'
    )
    parser.add_argument(
        "--meshes",
        nargs="*",
        default=["goathead"],
        metavar="NAME",
        help="sculptures beside the sphere: NAME.obj",
    )
    parser.add_argument("--size", type=int, default=40, help="width and height of the images [pixels]")
    parser.add_argument("--seed", type=int, default=0, help="of the recordings")
    parser.add_argument("--preset", default="balanced", choices=("fast", "balanced", "accurate"))
    options = parser.parse_args(argv)
    evsdr.load_scene(SCENES / "sphere.xml", size=8)  # starts the renderer
    print(HEAD, "|---" * (HEAD.count("|") - 1) + "|", sep="\n", flush=True)
    results = []
    with tempfile.TemporaryDirectory() as folder:
        for case in cases(Path(folder), options.meshes):
            if any(case.name.startswith(name) for name in options.only or [""]):
                results.append(run(case, options.size, Settings(preset=options.preset), options.seed))
                print(line(results[-1]), flush=True)
    for result in results:
        print(f"\n{result.name}\n  modelled: {result.modelled}\n  verdict: {result.verdict}")


def line(result: Result) -> str:
    """Lay a result out."""
    shares = [" ".join(f"{w:.0%}" for w in within) for within in (result.within, result.reflectance_within)]
    cells = (
        result.name,
        f"{result.known:.0%}",
        f"{result.error_deg:.2f}, {result.median_deg:.2f}",
        f"{result.sigma_deg:.2f}",
        shares[0],
        "" if result.metal else shares[1],
        f"{result.seconds:.0f}",
        result.verdict.partition(":")[0],
    )
    return f"| {' | '.join(cells)} |"


if __name__ == "__main__":
    main()
