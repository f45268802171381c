"""Build the firmware and its bench, and run them, by a script or beside a host."""

import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from evsdr.rig.protocol import frame, unframe

FIRMWARE = Path(__file__).resolve().parents[2] / "firmware"
ELF, BENCH = FIRMWARE / "build" / "ring.elf", FIRMWARE / "build" / "bench"
BEAT_US = 10_000  # between two keep-alives
BEAT = "65535 STATUS"
BOOT_US = 3000  # after a reset, until the ring listens


def missing() -> str | None:
    """Say what the bench lacks on this machine, or None."""
    if not (FIRMWARE / "Makefile").is_file():
        return "no folder firmware"
    for program in ("make", "avr-gcc", "cc"):
        if not shutil.which(program):
            return f"no {program}"
    headers = (Path("/usr/include/simavr/sim_avr.h"), Path("/usr/local/include/simavr/sim_avr.h"))
    return None if any(path.is_file() for path in headers) else "no libsimavr"


def build(n_led: int = 24) -> Path:
    """Build firmware and bench if they are older than their sources; gives the firmware."""
    make = ["make", "-s", "-C", FIRMWARE, "all", f"LEDS={n_led}"]
    subprocess.run(make, check=True, stdout=subprocess.DEVNULL)
    subprocess.run(["make", "-s", "-C", FIRMWARE, "bench"], check=True)
    return ELF if n_led == 24 else ELF.parent / str(n_led) / ELF.name


@dataclass(frozen=True)
class Line:
    """A line of the bench's output: simulated time [us], and what happened."""

    t_us: float
    text: str

    @property
    def answer(self) -> str | None:
        """What the UART said, checksum checked and taken off; None for anything else."""
        return unframe(self.text[2:].encode("latin-1")) if self.text.startswith("> ") else None


class Script:
    """What shall happen on the bench, one after the other."""

    def __init__(self):
        self.lines = [f"wait {BOOT_US}"]

    def add(self, *lines: str) -> "Script":
        """Add commands of the bench, see `firmware/bench/bench.c`."""
        self.lines += lines
        return self

    def ask(self, *commands: str) -> "Script":
        """Send requests, each after the answer to the one before."""
        for command in commands:
            number = len(self.lines) % 60_000
            self.add(f"send {frame(f'{number} {command}').hex()}", "answer 20000", "wait 1000")
        return self

    def beat(self) -> "Script":
        """Keep the ring alive from now on."""
        return self.add(f"beat {BEAT_US} {frame(BEAT).hex()}")

    def run(self, vcd: Path | None = None, elf: Path = ELF) -> list[Line]:
        """Run it, as fast as it goes; gives the output without the answers to keep-alives."""
        command = [BENCH, elf, *(("--vcd", vcd) if vcd else ())]
        text = "\n".join([*self.lines, "quit", ""])
        done = subprocess.run(command, input=text, capture_output=True, encoding="latin-1")
        if done.returncode:
            raise RuntimeError(done.stderr)
        lines = (line.partition(" ") for line in done.stdout.splitlines() if line[:1].isdigit())
        return [Line(float(t), text) for t, _, text in lines if not text.startswith("> 65535 ")]


@contextmanager
def beside_host(vcd: Path | None = None) -> Iterator[tuple[str, "subprocess.Popen[str]"]]:
    """Run the bench beside a host; gives the name of its terminal, and the process, to send it commands."""
    command = [BENCH, ELF, "--pty", *(("--vcd", vcd) if vcd else ())]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
    ) as bench:
        try:
            port = next(line.strip() for line in bench.stdout if line.startswith("/dev/"))
            yield port, bench
            bench.stdin.write("quit\n")
            bench.stdin.close()
            bench.stdout.read()
            bench.wait(timeout=60)
        finally:
            bench.kill()
