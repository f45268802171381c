"""From the host's command through firmware, pins, light and events to a normal map."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

import evsdr
from evsdr import EventPixel, Events, Recording, Schedule, Settings
from evsdr.fitting.simulation import render
from evsdr.rig.driver import Ring, RingSettings
from evsdr.rig.log import RingLog, read_ring_log, write_ring_log
from experiments.bench.light import FULL, Trace, read_trace
from experiments.bench.simulator import beside_host
from experiments.bench.vcd import CYCLES_PER_US, N_LED, mean_light

KNOT_US = 80  # five periods of the carrier, over which the measured light is averaged
CAMERA_US = 12_345  # the camera's clock at the start of the first round
PIXEL = EventPixel(0.25, 0.25).idealised()


@dataclass(frozen=True)
class Errors:
    """Mean angle between recovered and true normals [deg]: by the ring's pins, and by an ideal schedule."""

    ring_deg: float
    ideal_deg: float


def drive(folder: Path, slot_us: int, rounds: int) -> tuple[Trace, RingLog]:
    """Let the host run the ring on the bench; leaves pins.vcd and ring.json in the folder."""
    with beside_host(folder / "pins.vcd") as (port, _), Ring(port) as ring:
        log = ring.run(RingSettings(slot_us=slot_us, rounds=rounds))
    write_ring_log(folder / "ring.json", log)
    return read_trace(folder / "pins.vcd"), read_ring_log(folder / "ring.json")


def record_pins(
    signal: np.ndarray, constant_light: float, trace: Trace, log: RingLog, seed: int = 0
) -> Recording:
    """Give what the camera records of the light that the pins tell.

    Between knots the light is linear: to the simulator each knot is an LED of its own.
    """
    n_led = len(signal)
    first, last = trace.rounds[0], trace.rounds[-1]
    n_knot = int((last - first) / (KNOT_US * CYCLES_PER_US)) + 1
    edge = first + (np.arange(n_knot + 1) - 0.5) * KNOT_US * CYCLES_PER_US
    edge = np.clip(edge, first, last)  # the camera sees the run, and nothing before and after it
    weight = np.column_stack([mean_light(trace.pulses[led % 2], led, edge) / FULL for led in range(N_LED)])
    knots = np.tensordot(weight[:, :n_led], signal, axes=1)
    schedule = Schedule(np.arange(n_knot), KNOT_US, 1.0, CAMERA_US)
    recording = evsdr.record(knots, constant_light, PIXEL, schedule, 1, seed)
    events = recording.events
    real = events.t < CAMERA_US + (n_knot - 1) * KNOT_US  # then the simulator starts over
    events = Events(events.x[real], events.y[real], events.p[real], events.t[real])
    triggers = np.rint((trace.rounds - first) / CYCLES_PER_US).astype(np.int64) + CAMERA_US
    asked = Schedule(log.order, log.slot_us, log.crossfade)
    return Recording(events, recording.sensor, asked, triggers)


def record_ideal(signal: np.ndarray, constant_light: float, log: RingLog, seed: int = 0) -> Recording:
    """Give what the camera records of the schedule itself."""
    schedule = Schedule(log.order, log.slot_us, log.crossfade, CAMERA_US)
    return evsdr.record(signal, constant_light, PIXEL, schedule, log.n_round, seed)


def close_loop(
    folder: Path, file: Path, size: int, slot_us: int, rounds: int, n_seed: int = 3, preset: str = "balanced"
) -> Errors:
    """Run the ring, record a scene under it, fit the events; the same with an ideal schedule.

    The means are over `n_seed` draws of the pixels' noise.
    """
    scene = evsdr.load_scene(file, size=size)
    signal, truth = render(scene)
    trace, log = drive(folder, slot_us, rounds)

    def angle(recording: Recording) -> float:
        found = evsdr.fit(scene, recording, Settings(preset=preset, thresholds="known"))
        return evsdr.score(found.maps, truth)["mae_deg"]

    light = scene.constant_light
    ring_deg = [angle(record_pins(signal, light, trace, log, seed)) for seed in range(n_seed)]
    ideal_deg = [angle(record_ideal(signal, light, log, seed)) for seed in range(n_seed)]
    return Errors(float(np.mean(ring_deg)), float(np.mean(ideal_deg)))
