"""A ring without a chip: it answers as the firmware does, on the clock of this machine's kernel.

As a process, `python -m experiments.bench.stand_in PORT ROUND_S`, it answers at a descriptor, and prints, once its standard input
is closed, what the lines that came tell: where two of them lie further apart than ALIVE allows, a real ring would have gone
dark. It runs before all else where the system lets it, and tells how late it was at worst, so that nobody takes a computer that
stood still for a host that was silent.
"""

import contextlib
import json
import os
import select
import sys
import time

from evsdr.rig.keeper import go_first
from evsdr.rig.protocol import Lines, frame

TICK_S = 0.001  # between two looks at the clock
PRIORITY = 50  # above the host's keeper


class StandIn:
    """The state of a ring, and its answers.

    Parameters
    ----------
    round_s : float
        Length of a round [s].
    protocol : int
        Version that it claims.
    alive_s : float
        Silence of the host after which all goes dark [s]; the host may ask for another. Infinite: none does.
    """

    def __init__(self, round_s: float = 0.05, protocol: int = 1, alive_s: float = float("inf")):
        self.round_s, self.protocol, self.alive_s = round_s, protocol, alive_s
        self.lit = self.light = False
        self.rounds, self.asked, self.cause = 0, 0, "none"
        self.silence_s = 0.0  # the longest while something was lit
        self._start = self._heard = 0.0

    def advance(self, now: float) -> None:
        """Let the run go on."""
        if self.lit:
            self.rounds = int((now - self._start) / self.round_s)
            if self.asked and self.rounds >= self.asked:
                self.rounds, self.lit, self.cause = self.asked, False, "done"

    def answer(self, text: str, now: float) -> str:
        """Take a line that came at a time [s] and give the answer."""
        self._hear(now)
        self.advance(now)
        number, name, *arguments = text.split(" ")
        words = ""
        if name == "HELLO":
            words = f" fake protocol={self.protocol} leds=24 slots=256 alive_ms=40 max_on_us=2000000"
        elif name == "STATUS":
            cause = "none" if self.lit else self.cause
            words = f" run={int(self.lit)} rounds={self.rounds} light={int(self.light)} cause={cause}"
        elif name == "SLOT":
            periods, extra = divmod(16 * int(arguments[0]), 256)
            words = f" periods={periods} extra={extra} fade={round(periods * int(arguments[1]) / 1e6)}"
        elif name == "ROUNDS":
            self.asked = int(arguments[0])
        elif name == "ALIVE" and self.alive_s < float("inf"):
            self.alive_s = 1e-3 * int(arguments[0])
        elif name == "LIGHT":
            self.light = arguments == ["1"]
        elif name == "RUN" and not self.lit:
            self.lit, self.cause, self._start = True, "none", now
        elif name == "STOP" and self.lit:
            self.lit, self.cause = False, "stop"
        return f"{number} OK{words}"

    def _hear(self, now: float) -> None:
        """Go dark if the line before this one is too long ago."""
        if self.lit or self.light:
            silence_s = now - self._heard
            self.silence_s = max(self.silence_s, silence_s)
            if silence_s > self.alive_s:
                self.light = False
                if self.lit:
                    self.lit, self.cause = False, "alive"
        self._heard = now


def serve(port: int, ring: StandIn) -> float:
    """Answer until standard input closes; gives how late this process was at worst [s]."""
    lines, late_s = Lines(), 0.0
    while True:
        before = time.monotonic()
        ready, _, _ = select.select([port, sys.stdin], [], [], TICK_S)
        now = time.monotonic()
        if not ready:
            late_s = max(late_s, now - before - TICK_S)
        if sys.stdin in ready:
            return late_s
        if port in ready:
            for text in lines.take(os.read(port, 4096)):
                with contextlib.suppress(OSError):  # the host has gone, or takes nothing
                    os.write(port, frame(ring.answer(text, now)))


def main() -> None:
    """Run as a process."""
    go_first(PRIORITY)
    ring = StandIn(float(sys.argv[2]), alive_s=0.04)
    late_s = serve(int(sys.argv[1]), ring)
    print(json.dumps({"silence_ms": 1e3 * ring.silence_s, "late_ms": 1e3 * late_s}), flush=True)


if __name__ == "__main__":
    main()
