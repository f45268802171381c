"""Measure the renderer, the solver, and what lies between files and maps.

python -m experiments.benchmark release     # seconds of each stage, into a JSON of this release
python -m experiments.benchmark ring        # one pass against one stock render per LED
python -m experiments.benchmark gradients   # automatic against finite differences
python -m experiments.benchmark presets     # seconds, memory and errors of whole fits
python -m experiments.benchmark solvers     # Levenberg-Marquardt beside the published decoder
"""

import sys

import tyro

from evsdr import InputError, jit


def main(argv: list[str] | None = None) -> int:
    """Run one of the benchmarks."""
    try:
        jit.start()
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    from . import fitting, gradients, one_pass, stages  # they import Mitsuba

    commands = {
        "release": stages.report,
        "ring": one_pass.report,
        "gradients": gradients.report,
        "presets": fitting.report_presets,
        "solvers": fitting.report_solvers,
    }
    tyro.extras.subcommand_cli_from_dict(commands, prog="benchmark", description=__doc__, args=argv)
    return 0


if __name__ == "__main__":
    sys.exit(main())
