"""Random and mutated protocol lines: none may hang the ring or leave an LED on."""

from dataclasses import dataclass

import numpy as np

from evsdr.rig.protocol import frame
from experiments.bench.simulator import Line, Script

VALID = (
    "HELLO", "STATUS", "SLOT 10000 1000000", "SLOT 200 0", "SLOT 1000000 500000", "ORDER ABCDEFGHIJKLMNOPQRSTUVWX",
    "ORDER A.B", "ORDER ACE", "TRIM " + 24 * "80", "ROUNDS 0", "ROUNDS 3", "SYNC 1", "LIGHT 1", "RUN", "RUN", "RUN", "STOP",
)  # fmt: skip
CHECKS = (
    "STOP", "HELLO", "STATUS", "SLOT 1000 500000", "ORDER ABCDEFGHIJKLMNOPQRSTUVWX", "TRIM " + 24 * "FF", "ROUNDS 1",
    "SYNC 0", "LIGHT 0", "RUN", "STOP",
)  # fmt: skip
DARK_US = 50_000  # the most that light may outlive the last line


@dataclass(frozen=True)
class Fuzzed:
    """What came of it.

    Attributes
    ----------
    lines, answers : int
        Sent, and answered.
    runs : int
        How often the light went on.
    longest_us : float
        That light outlived the last line of those that were sent one after another [us].
    refused : list of str
        Valid commands at the end that did not get OK.
    dark : bool
        At the very end.
    """

    lines: int
    answers: int
    runs: int
    longest_us: float
    refused: list[str]
    dark: bool


def spoil(rng: np.random.Generator) -> bytes:
    """Give a line that nobody should send, or, now and then, one that somebody should."""
    number = int(rng.integers(0, 70000))
    line = bytearray(frame(f"{number} {VALID[rng.integers(len(VALID))]}"))
    kind = rng.integers(8)
    if kind == 0:
        return rng.integers(0, 256, rng.integers(1, 40), np.uint8).tobytes() + b"\n"
    if kind == 1:  # overlong
        return rng.integers(32, 127, rng.integers(97, 300), np.uint8).tobytes() + b"\n"
    if kind == 2:  # bytes are lost
        for _ in range(rng.integers(1, 4)):
            del line[rng.integers(len(line))]
    if kind == 3:  # bytes are others
        for _ in range(rng.integers(1, 4)):
            line[rng.integers(len(line))] ^= 1 << rng.integers(8)
    if kind == 4:  # half a command
        return bytes(line[: rng.integers(1, len(line))])
    if kind == 5:  # nonsense, well framed
        text = "".join(chr(c) for c in rng.choice(list(b" 0123456789ABRUNSTOPLIGHT.-"), rng.integers(0, 60)))
        return frame(text)
    if kind == 6:  # arguments that make no sense
        word = VALID[rng.integers(len(VALID))].split(" ")[0]
        return frame(f"{number} {word} {rng.integers(-5, 2**31)} {rng.integers(0, 2**40)}")
    return bytes(line)


def fuzz(n_line: int, seed: int, pause: int = 200) -> Fuzzed:
    """Send spoiled lines, waiting for each answer but not long; be silent after every `pause` lines.

    In each silence all must go dark in time; after all of them every valid command must be obeyed.
    """
    rng = np.random.default_rng(seed)
    script = Script()
    for k in range(n_line):
        script.add(f"send {spoil(rng).hex()}", "answer 1500")
        if k % pause == pause - 1:
            script.add("mark", f"wait {DARK_US + 5000}", "mark")
    script.add("send 0a", "wait 10000", "mark", "mark").ask(*CHECKS).add("wait 60000")
    lines = script.run()
    last_mark = max(k for k, line in enumerate(lines) if line.text == "mark")
    answers = [line.answer.split(" ")[1] for line in lines[last_mark:] if line.answer]
    refused = [command for command, word in zip(CHECKS, answers) if word != "OK"] + list(
        CHECKS[len(answers) :]
    )
    longest, lit = _afterglow(lines)
    return Fuzzed(
        n_line,
        sum(line.answer is not None for line in lines),
        sum(line.text == "lit" for line in lines),
        longest,
        refused,
        not lit,
    )


def _afterglow(lines: list[Line]) -> tuple[float, bool]:
    """Give the longest light after the first of two marks [us], and if it is lit at the end."""
    longest, mark, lit, marks = 0.0, 0.0, False, 0
    for line in sorted(lines, key=lambda line: line.t_us):
        if line.text == "mark":
            mark, marks = line.t_us, marks + 1
            if lit and marks % 2 == 0:
                longest = np.inf  # still lit when the silence is over
        elif line.text == "lit":
            lit = True
        elif line.text == "dark":
            lit = False
            if marks % 2:
                longest = max(longest, line.t_us - mark)
    return longest, lit
