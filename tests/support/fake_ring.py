"""A ring in Python behind a terminal: answers as the firmware does, over a line that may be bad."""

import os
import select
import threading
import time
import tty

from evsdr.rig.protocol import frame, unframe
from experiments.bench.stand_in import StandIn


class FakeRing(StandIn):
    """Runs in a thread while it is open; what it is told it keeps in `commands`.

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
        super().__init__(round_s, protocol)
        self.spoil, self.commands, self.silent = spoil, [], False
        self.pressed = threading.Event()

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
            self.advance(time.monotonic())
            if self.pressed.is_set():
                self.boot()
            if not select.select([self.master], [], [], 0.002)[0]:
                continue
            *lines, rest = (rest + os.read(self.master, 4096)).split(b"\n")
            for line in filter(None, lines):
                self.hear(unframe(self.spoil(line)))

    def reset(self):
        """Press the button; the thread that answers starts anew, so that it says so before any answer."""
        self.pressed.set()

    def boot(self):
        """Start anew."""
        self.pressed.clear()
        self.lit, self.light, self.rounds, self.cause = False, False, 0, "none"
        self.say("# BOOT fake protocol=1 reset=2")

    def say(self, text):
        if not self.silent:
            os.write(self.master, self.spoil(frame(text)[:-1]) + b"\n")

    def hear(self, text):
        if text is None:
            return self.say("- ERR 1 checksum")
        self.commands.append(text.partition(" ")[2])
        return self.say(self.answer(text, time.monotonic()))
