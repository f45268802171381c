"""`python -m experiments.view_faults`: faults of recordings, and which check of `evsdr.view` finds each."""

import argparse
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import evsdr
from evsdr.fitting.simulation import render
from evsdr.viewing.check import DOUBTFUL, WRONG, verdict
from evsdr.viewing.checks import examine
from evsdr.viewing.look import look_at
from evsdr.viewing.source import open_watched
from experiments.lamp import under_a_lamp

SCENES = {"sphere": "sphere", "blob": "blob", "chart": "colorchecker"}
ROUNDS = 4


@dataclass(frozen=True)
class Fault:
    """A fault, how a recording comes by it, and whether only a scene shows it."""

    name: str
    make: Callable  # (Bench) -> Recording
    scene: bool = False


@dataclass(frozen=True)
class Bench:
    """A scene, and the light of its LEDs."""

    ring: object
    signal: np.ndarray

    def schedule(self, slot_us: float = 20_000.0, crossfade: float = 1.0) -> evsdr.Schedule:
        return evsdr.Schedule(np.arange(len(self.signal), dtype=np.int32), slot_us, crossfade)

    def record(self, signal=None, pixel=evsdr.EventPixel(), **schedule) -> evsdr.Recording:
        light = self.signal if signal is None else signal
        return evsdr.record(light, self.ring.constant_light, pixel, self.schedule(**schedule), ROUNDS)

    def under_a_lamp(self, hz: float, slot_us: float) -> evsdr.Recording:
        return under_a_lamp(self.signal, self.ring.constant_light, self.schedule(slot_us), hz, ROUNDS)

    def without(self, *leds: int) -> np.ndarray:
        return np.where(np.isin(np.arange(len(self.signal)), leds)[:, None, None], 0, self.signal)

    def swapped(self, i: int, j: int) -> np.ndarray:
        order = np.arange(len(self.signal))
        order[[i, j]] = j, i
        return self.signal[order]


def told(recording: evsdr.Recording, **schedule) -> evsdr.Recording:
    """Tell the schedule otherwise."""
    return replace(recording, schedule=replace(recording.schedule, **schedule))


def triggers(recording: evsdr.Recording, starts) -> evsdr.Recording:
    """Keep other triggers."""
    return replace(recording, round_start_us=np.asarray(starts, np.int64))


def mirrored(recording: evsdr.Recording) -> evsdr.Recording:
    """Mirror the image in x."""
    events, sensor = recording.events, recording.sensor
    thresholds = {
        name: np.fliplr(getattr(sensor, name)) for name in ("contrast_threshold_on", "contrast_threshold_off")
    }
    x = (sensor.width - 1 - events.x).astype(np.uint16)
    return replace(recording, events=replace(events, x=x), sensor=replace(sensor, **thresholds))


FAULTS = (
    Fault("none, slots of 20 ms", lambda b: b.record(), True),
    Fault("none, slots of 5 ms", lambda b: b.record(slot_us=5_000.0), True),
    Fault("LED 7 is dead", lambda b: b.record(b.without(7))),
    Fault("LEDs 3 and 12 are swapped", lambda b: b.record(b.swapped(3, 12)), True),
    Fault("a trigger is missing", lambda b: triggers(r := b.record(), np.delete(r.round_start_us, 2))),
    Fault("the last trigger is missing", lambda b: triggers(r := b.record(), r.round_start_us[:-1])),
    Fault("light of 100 Hz, slots of 20 ms", lambda b: b.under_a_lamp(100.0, 20_000.0)),
    Fault("light of 100 Hz, slots of 10 ms", lambda b: b.under_a_lamp(100.0, 10_000.0)),
    Fault("light of 120 Hz, slots of 10 ms", lambda b: b.under_a_lamp(120.0, 10_000.0)),
    Fault(
        "pixels rest for 2 ms, slots of 5 ms",
        lambda b: b.record(pixel=evsdr.EventPixel(refractory_us=2_000.0), slot_us=5_000.0),
    ),
    Fault("1 % of the pixels are hot", lambda b: b.record(pixel=evsdr.EventPixel(hot_fraction=0.01))),
    Fault("slots told 10 times too long", lambda b: told(b.record(), slot_us=200_000.0)),
    Fault("slots told 5 % too long, no triggers", lambda b: triggers(told(b.record(), slot_us=21_000.0), [])),
    Fault(
        "rounds told to start 6 ms early, no triggers",
        lambda b: triggers(told(b.record(), start_us=-6_000.0), []),
    ),
    Fault("LEDs switch hard", lambda b: b.record(crossfade=0.0)),
    Fault("the image is mirrored", lambda b: mirrored(b.record()), True),
)


def found(bench: Bench, fault: Fault, folder: Path) -> str:
    """Make a recording with a fault, look at it, and say what speaks."""
    path = folder / "events.h5"
    evsdr.write_recording(path, fault.make(bench))
    checks = examine(look_at(open_watched(path), bench.ring if fault.scene else None))
    odd = [check.name for check in checks if check.state in (DOUBTFUL, WRONG)]
    return verdict(checks) + (f": {', '.join(odd)}" if odd else "")


def main(argv: list[str] | None = None) -> None:
    """Print a table of faults and findings."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", type=int, default=32, help="pixels along a side")
    parser.add_argument("--fault", default="", help="only those whose names hold this")
    options = parser.parse_args(argv)
    scenes = Path(__file__).resolve().parent.parent / "scenes"
    benches = []
    for name in SCENES.values():
        ring = evsdr.load_scene(scenes / f"{name}.xml", size=options.size)
        benches.append(Bench(ring, render(ring)[0]))
    print(f"| fault | scene told | {' | '.join(SCENES)} |\n|---|---|{'---|' * len(SCENES)}")
    with tempfile.TemporaryDirectory() as folder:
        for fault in (f for f in FAULTS if options.fault in f.name):
            cells = [found(bench, fault, Path(folder)) for bench in benches]
            print(f"| {fault.name} | {'yes' if fault.scene else 'no'} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
