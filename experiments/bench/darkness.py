"""How soon all is dark when a run ends before its time."""

import numpy as np

from evsdr.rig.protocol import frame
from experiments.bench.simulator import Line, Script

BEFORE_US = 31_000  # of the run, until something happens
STOP = f"send {frame('1 STOP').hex()}"
ENDINGS = {
    "stop": (STOP,),
    "reset": ("reset",),
    "program hangs": ("hang",),
    "hangs, interrupts off": ("freeze",),
    "carrier stalls": ("stall",),
    "host silent": ("beat 0",),
    "cable pulled": ("cut", "beat 0"),
}


def end_early(ending: str) -> tuple[float, list[Line]]:
    """End a run in one of the ways of ENDINGS.

    Returns
    -------
    us : float
        From then to the dark [us]; infinite if it comes not at all, or not for good.
    lines : list of Line
        What the bench said.
    """
    script = Script().ask("SLOT 1000 1000000", "ROUNDS 0").beat().ask("RUN")
    script.add(f"wait {BEFORE_US}", "mark", *ENDINGS[ending], "wait 300000", "mark")
    lines = script.run()
    start = next(line.t_us for line in lines if line.text == "mark")
    light = sorted((line.t_us, line.text) for line in lines if line.text in ("lit", "dark"))
    lit_once = [text for _, text in light] == ["lit", "dark"]
    return (max(light[-1][0] - start, 0.0) if lit_once else np.inf), lines
