"""How soon all is dark when a run ends before its time."""

from pathlib import Path

import numpy as np

from evsdr.rig.protocol import frame
from experiments.bench.simulator import Line, Script

BEFORE_US = 31_000  # of the run, until something happens
FALL_US = 2500  # of the supply, when the cable is pulled: 150 uF from 5 V to 2.7 V at 0.14 A
BOOT = "boot 1000000"  # a bootloader that waits for a second, as the Uno's does
STOP = f"send {frame('1 STOP').hex()}"


def _ramp(first_mv: int, last_mv: int, us: int) -> tuple[str, ...]:
    """Let the supply go from one voltage to another in steps of 100 mV."""
    sign = 1 if last_mv > first_mv else -1
    steps = range(first_mv + sign * 100, last_mv + sign, sign * 100)
    return tuple(line for mv in steps for line in (f"rail {mv}", f"wait {max(us // len(steps), 1)}"))


ENDINGS = {
    "stop": (STOP,),
    "reset": ("reset",),
    "reset, then the bootloader": (BOOT, "reset", "wait 1100000"),
    "program hangs": ("hang",),
    "hangs, interrupts off": ("freeze",),
    "carrier stalls": ("stall",),
    "host silent": ("beat 0",),
    "host silent, ALIVE 49": (f"send {frame('2 ALIVE 49').hex()}", "wait 900", "beat 0"),
    "cable pulled": ("cut", "beat 0"),
    "supply sags to 3.5 V": ("rail 3500",),
    "supply drops to 2.6 V, below the brown-out limit": ("rail 2600",),
    "supply drops to 2.6 V and comes back": ("rail 2600", "wait 5000", "rail 5000"),
    "USB unplugged": (*_ramp(5000, 0, FALL_US), "beat 0"),
    "USB unplugged and plugged in": (BOOT, *_ramp(5000, 0, FALL_US), "wait 9000", *_ramp(0, 5000, 1000)),
}
SUPPLY = tuple(name for name in ENDINGS if name.startswith(("supply", "USB")))


def end_early(ending: str, apart_mv: int = 0, vcd: Path | None = None) -> tuple[float, list[Line]]:
    """End a run, with the constant light on, in one of the ways of ENDINGS.

    Parameters
    ----------
    ending : str
        Which.
    apart_mv : int
        What feeds shift registers and LEDs in place of the Uno's 5 V [mV]; 0 for nothing.
    vcd : Path, optional
        Gets the pins.

    Returns
    -------
    us : float
        From then to the dark [us]; infinite if it comes not at all, or not for good.
    lines : list of Line
        What the bench said.
    """
    script = (
        Script().add(f"apart {apart_mv}").ask("SLOT 1000 1000000", "ROUNDS 0").beat().ask("LIGHT 1", "RUN")
    )
    script.add(f"wait {BEFORE_US}", "mark", *ENDINGS[ending], "wait 300000", "mark")
    lines = script.run(vcd)
    start = next(line.t_us for line in lines if line.text == "mark")
    light = sorted((line.t_us, line.text) for line in lines if line.text in ("lit", "dark"))
    lit_once = [text for _, text in light] == ["lit", "dark"]
    return (max(light[-1][0] - start, 0.0) if lit_once else np.inf), lines
