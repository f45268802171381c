"""A ring in Python behind a terminal: answers as the firmware does, over a line that may be bad."""

import os
import select
import threading
import time
import tty

from evsdr.rig.protocol import frame, unframe


class FakeRing:
    """Runs in a thread while it is open.

    Parameters
    ----------
    protocol : int
        Version that it claims.
    spoil : callable (bytes) -> bytes
        What the line makes of each line, either way.
    round_s : float
        Length of a round [s].
    """

    def __init__(self, protocol=1, spoil=lambda line: line, round_s=0.05):
        self.protocol, self.spoil, self.round_s = protocol, spoil, round_s
        self.commands, self.silent = [], False
        self.lit = self.light = False
        self.rounds, self.asked, self.cause, self.start = 0, 0, "none", 0.0

    def __enter__(self):
        self.master, slave = os.openpty()
        tty.setraw(slave)
        self.port, self.slave = os.ttyname(slave), slave
        self.open = True
        self.thread = threading.Thread(target=self.serve)
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.open = False
        self.thread.join()
        os.close(self.master)
        os.close(self.slave)

    def serve(self):
        rest = b""
        while self.open:
            self.advance()
            if not select.select([self.master], [], [], 0.002)[0]:
                continue
            *lines, rest = (rest + os.read(self.master, 4096)).split(b"\n")
            for line in filter(None, lines):
                self.answer(unframe(self.spoil(line)))

    def advance(self):
        """Let the run go on."""
        if self.lit:
            self.rounds = int((time.monotonic() - self.start) / self.round_s)
            if self.asked and self.rounds >= self.asked:
                self.rounds, self.lit, self.cause = self.asked, False, "done"

    def reset(self):
        """Start anew, as after a press of the button."""
        self.lit, self.light, self.rounds, self.cause = False, False, 0, "none"
        self.say("# BOOT fake protocol=1 reset=2")

    def say(self, text):
        if not self.silent:
            os.write(self.master, self.spoil(frame(text)[:-1]) + b"\n")

    def answer(self, text):
        if text is None:
            return self.say("- ERR 1 checksum")
        number, name, *arguments = text.split(" ")
        self.commands.append(" ".join([name, *arguments]))
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
        elif name == "LIGHT":
            self.light = arguments == ["1"]
        elif name == "RUN" and not self.lit:
            self.lit, self.cause, self.start = True, "none", time.monotonic()
        elif name == "STOP" and self.lit:
            self.lit, self.cause = False, "stop"
        return self.say(f"{number} OK{words}")
