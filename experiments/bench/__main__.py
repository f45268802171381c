"""`python -m experiments.bench`: everything that can be known of the ring without the ring."""

import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from evsdr import InputError
from evsdr.commands.console import print_table, run_command
from evsdr.rig.driver import RingSettings, order_commands
from evsdr.rig.protocol import ALIVE_MS
from experiments.bench import fuzz, light, simulator
from experiments.bench.alive import Run, run_beside
from experiments.bench.darkness import ENDINGS, end_early

REPOSITORY = Path(__file__).resolve().parents[2]
DARK_US = 50_000.0
FUZZERS = 2
BUSY = 4


@dataclass(frozen=True)
class Options:
    """Run the firmware on a simulated ATmega328P and check timing, light, safety, protocol and normals."""

    size: int = 48
    """Pixels on a side of the scene of the whole loop."""
    lines: int = 100_000
    """Random and mutated protocol lines."""
    seed: int = 0
    """Of those lines."""
    alive_runs: int = 3
    """Runs of 10 s beside four busy processes, for each of two priorities."""


def main(argv: list[str] | None = None) -> int:
    """Run the command; gives its exit status, 1 if a figure is out of bounds."""
    failed: list[str] = []
    status = run_command("bench", Options, lambda options: command(options, failed), argv)
    for name in failed:
        print(f"out of bounds: {name}", file=sys.stderr)
    return status or int(bool(failed))


def command(options: Options, failed: list[str]) -> None:
    """Measure and print; names of what is out of bounds go into `failed`."""
    lacks = simulator.missing()
    if lacks:
        raise InputError(f"The bench can't run: {lacks}; install gcc-avr, avr-libc and libsimavr-dev.")
    simulator.build()
    for part in (timing, darkness, lines, alive, loop):
        start = time.monotonic()
        rows = part(options)
        failed += [name for name, _, right in rows if not right]
        title = f"{part.__doc__.splitlines()[0]} ({time.monotonic() - start:.0f} s)"
        print_table(title, [(name, figure) for name, figure, _ in rows])


def run_settings(settings: RingSettings, folder: Path, elf: Path = simulator.ELF) -> light.Trace:
    """Run settings to the end on the bench, without a host."""
    script = simulator.Script().ask(
        f"SLOT {int(settings.slot_us)} {round(1e6 * settings.crossfade)}",
        *order_commands(settings.order),
        "TRIM " + "".join(f"{round(255 * value):02X}" for value in settings.trim),
        f"ROUNDS {settings.rounds}",
        f"SYNC {int(settings.sync_slots)}",
    )
    length = settings.slot_us * len(settings.order) * settings.rounds
    script.beat().ask("RUN").add(f"wait {int(length) + 5000}").run(folder / "pins.vcd", elf)
    return light.read_trace(folder / "pins.vcd", settings.n_led)


def timing(options: Options) -> list[tuple[str, str, bool]]:
    """Timing and light, from the pins."""
    trims = tuple(np.linspace(0.2, 1, 24))
    fades = {
        "crossfade 1, 10 ms": RingSettings(slot_us=10_000, rounds=2),
        "crossfade 1, 200 us": RingSettings(slot_us=200, rounds=20),
        "crossfade 0.4, 1003 us, trimmed": RingSettings(slot_us=1003, crossfade=0.4, rounds=5, trim=trims),
        "dark and repeated slots, 2 ms": RingSettings((0, -1, 2, 2, 3, -1, -1, 5, 4, -1), 2000, 1.0, 5),
        "crossfade 1, 1 s": RingSettings((0, 1, -1), 1_000_000, 1.0, 1),
    }
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        hard = RingSettings(slot_us=200, crossfade=0.0, rounds=417, sync_slots=True)
        trace = run_settings(hard, folder)
        by_trigger, by_light, n_slot = light.edge_error_us(trace, hard)
        stray = light.stray_pulses(trace, hard)
        n_pulse = sum(len(pulses.led) for pulses in trace.pulses)
        rows = [
            (f"slot edges off schedule, {n_slot:,} slots, trigger", f"{by_trigger:.4f} us", by_trigger <= 1),
            ("the same, light", f"{by_light:.4f} us", by_light <= 1),
        ]
        for name, settings in fades.items():
            trace = run_settings(settings, folder)
            if len(trace.rounds) != settings.rounds + 1:
                rows.append((name, "not complete", False))
                continue
            error = max(light.light_error(trace, settings))
            rows.append((f"light off schedule, {name}", f"{error:.2%}", error <= 0.01))
            stray += light.stray_pulses(trace, settings)
            n_pulse += sum(len(pulses.led) for pulses in trace.pulses)
            if name == "crossfade 1, 10 ms":
                low, high = light.carrier_khz(trace)
                rows.append(("carrier", f"{low:g} to {high:g} kHz", low == high == 62.5))
    rows.append((f"pulses of a wrong LED, of {n_pulse:,}", str(stray), stray == 0))
    return rows


def darkness(options: Options) -> list[tuple[str, str, bool]]:
    """Time to the dark, when a run ends before its time or the supply fails."""
    rows = []
    for ending in ENDINGS:
        us, _ = end_early(ending)
        rows.append((ending, f"{1e-3 * us:.3f} ms", us <= DARK_US))
    us, _ = end_early("USB unplugged", apart_mv=5000)
    return [
        *rows,
        ("USB unplugged, LEDs with a supply of their own", "lit" if us > DARK_US else "dark", us > DARK_US),
    ]


def lines(options: Options) -> list[tuple[str, str, bool]]:
    """Random and mutated protocol lines."""
    share = -(-options.lines // FUZZERS)
    with ThreadPoolExecutor(FUZZERS) as pool:
        parts = list(pool.map(lambda k: fuzz.fuzz(share, options.seed + k), range(FUZZERS)))
    longest = max(part.longest_us for part in parts)
    refused = sorted({command for part in parts for command in part.refused})
    dark = all(part.dark for part in parts)
    return [
        ("lines", f"{sum(part.lines for part in parts):,}", True),
        ("answered", f"{sum(part.answers for part in parts):,}", True),
        ("times the light went on", f"{sum(part.runs for part in parts):,}", True),
        ("longest light without a host", f"{1e-3 * longest:.1f} ms", longest <= DARK_US),
        ("valid commands refused afterwards", ", ".join(refused) or "none", not refused),
        ("dark at the end", "yes" if dark else "no", dark),
    ]


def alive(options: Options) -> list[tuple[str, str, bool]]:
    """Keep-alive beside four busy processes and a busy host, in the kernel's time.

    How long the computer itself stands still is its own business: what is judged is that the host tells of the dark
    if, and only if, the ring's own clock says that no line came in time.
    """
    rows = []
    for name, as_user in (("before all others", False), ("as any user", True)):
        runs = [run_beside(10.0, BUSY, as_user) for _ in range(options.alive_runs)]
        done = sum(run.ended == "done" for run in runs)
        rows += [
            (f"runs of 10 s that ended well, {name}", f"{done} of {len(runs)}", True),
            (
                "longest time without a line to the ring",
                f"{max(run.silence_ms for run in runs):.1f} ms",
                True,
            ),
            (
                "longest time for which the ring's process stood still",
                f"{max(run.late_ms for run in runs):.1f} ms",
                True,
            ),
            ("runs told as the ring's clock has them", *told_right(runs)),
        ]
    return rows


def told_right(runs: list[Run]) -> tuple[str, bool]:
    """Count the runs of which the host tells the truth: done, or dark as no line came in time."""
    right = sum((run.ended == "done") == (run.silence_ms <= ALIVE_MS) for run in runs)
    return f"{right} of {len(runs)}", right == len(runs)


def loop(options: Options) -> list[tuple[str, str, bool]]:
    """The whole loop: host, firmware, pins, light, events, normals."""
    from experiments.bench import loop

    file, size = REPOSITORY / "scenes" / "sphere.xml", options.size
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        plain, trimmed = (loop.close_loop(folder, file, size, way) for way in (loop.PLAIN, loop.TRIMMED))
        flicker = loop.close_flicker_loop(folder, file, size)
    ratio, trimmed_ratio = (one.ring_deg / one.ideal_deg for one in (plain, trimmed))
    return [
        ("mean angle, ring", f"{plain.ring_deg:.3f} deg", True),
        ("mean angle, ideal schedule", f"{plain.ideal_deg:.3f} deg", True),
        ("ratio", f"{ratio:.3f}", ratio <= 1.1),
        ("two LEDs at 0.25 and 0.6, ring", f"{trimmed.ring_deg:.3f} deg", True),
        ("the same, ideal schedule", f"{trimmed.ideal_deg:.3f} deg", True),
        ("ratio", f"{trimmed_ratio:.3f}", trimmed_ratio <= 1.1),
        (
            "the same, trim not told",
            f"{trimmed.untold_deg:.3f} deg",
            trimmed.untold_deg > 2 * trimmed.ring_deg,
        ),
        (
            "C_on, C_off by the ring's flicker, EVK4",
            f"{flicker.on:.1%}, {flicker.off:.1%}",
            flicker.on < 0.08,
        ),
        ("as told by one value", f"{flicker.nominal_on:.1%}, {flicker.nominal_off:.1%}", True),
        ("mean angle, thresholds by the flicker", f"{flicker.measured_deg:.3f} deg", True),
        (
            "thresholds as one value",
            f"{flicker.nominal_deg:.3f} deg",
            flicker.measured_deg < flicker.nominal_deg,
        ),
        ("true thresholds", f"{flicker.true_deg:.3f} deg", True),
    ]


if __name__ == "__main__":
    sys.exit(main())
