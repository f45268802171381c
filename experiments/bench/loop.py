"""From the host's command through firmware, pins, light and events to a normal map."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from evsdr.commands import fit, ring
from evsdr.events.pixel import EventPixel
from evsdr.events.simulator import simulate_events
from evsdr.files.events_h5 import write_recording
from evsdr.files.truth import write_truth
from evsdr.fitting.simulation import render
from evsdr.light.entry import open_scene
from evsdr.records import Events, Recording, Schedule, Sensor
from evsdr.rig.log import RingLog, read_ring_log
from experiments.bench.light import FULL, Trace, read_trace
from experiments.bench.simulator import beside_host
from experiments.bench.vcd import CYCLES_PER_US, N_LED, mean_light

KNOT_US = 80  # five periods of the carrier, over which the measured light is averaged
CAMERA_US = 12_345  # the camera's clock at the start of the first round
PIXEL = EventPixel(0.25, 0.25, 0, 0, 0.02, 52.0, 0, 0, 0, 0, 0)  # thresholds, their noise, refractory period


@dataclass(frozen=True)
class Errors:
    """Mean angle between recovered and true normals [deg]: by the ring's pins, and by an ideal schedule."""

    ring_deg: float
    ideal_deg: float


def drive(folder: Path, slot_us: int, rounds: int) -> tuple[Trace, RingLog]:
    """Let the host's command run the ring on the bench; leaves pins.vcd and ring.json in the folder."""
    words = f"run --slot-us {slot_us} --rounds {rounds} --log".split()
    with beside_host(folder / "pins.vcd") as (port, _):
        status = ring.main([*words, str(folder / "ring.json"), "--port", port])
    assert status == 0, "the run failed"
    return read_trace(folder / "pins.vcd"), read_ring_log(folder / "ring.json")


def record_pins(
    signal: np.ndarray, constant_light: float, trace: Trace, log: RingLog, seed: int = 0
) -> Recording:
    """Give what the camera records of the light that the pins tell.

    Between knots the light is linear: to the simulator each knot is an LED of its own.
    """
    n_led, height, width = signal.shape
    first, last = trace.rounds[0], trace.rounds[-1]
    n_knot = int((last - first) / (KNOT_US * CYCLES_PER_US)) + 1
    edge = first + (np.arange(n_knot + 1) - 0.5) * KNOT_US * CYCLES_PER_US
    edge = np.clip(edge, first, last)  # the camera sees the run, and nothing before and after it
    weight = np.column_stack([mean_light(trace.pulses[led % 2], led, edge) / FULL for led in range(N_LED)])
    knots = np.tensordot(weight[:, :n_led], signal, axes=1)
    schedule = Schedule(np.arange(n_knot), KNOT_US, 1.0, CAMERA_US)
    events = simulate_events(knots, constant_light, schedule, 1, PIXEL, seed)[0]
    real = events.t < CAMERA_US + (n_knot - 1) * KNOT_US  # then the simulator starts over
    events = Events(events.x[real], events.y[real], events.p[real], events.t[real])
    triggers = np.rint((trace.rounds - first) / CYCLES_PER_US).astype(np.int64) + CAMERA_US
    asked = Schedule(log.order, log.slot_us, log.crossfade)
    return Recording(events, _sensor(width, height), asked, triggers)


def record_ideal(signal: np.ndarray, constant_light: float, log: RingLog, seed: int = 0) -> Recording:
    """Give what the camera records of the schedule itself."""
    _, height, width = signal.shape
    schedule = Schedule(log.order, log.slot_us, log.crossfade, CAMERA_US)
    events, _, _, triggers = simulate_events(signal, constant_light, schedule, log.n_round, PIXEL, seed)
    return Recording(events, _sensor(width, height), schedule, triggers)


def _sensor(width: int, height: int) -> Sensor:
    return Sensor(
        width, height, PIXEL.contrast_threshold_on, PIXEL.contrast_threshold_off, PIXEL.refractory_us
    )


def close_loop(folder: Path, scene: Path, size: int, slot_us: int, rounds: int, n_seed: int = 3) -> Errors:
    """Run the ring, record a scene under it, fit the events; the same with an ideal schedule.

    The means are over `n_seed` draws of the pixels' noise.
    """
    define = (f"size={size}",)
    scene_of_size = open_scene(scene, {"size": str(size)})
    signal, truth = render(scene_of_size)
    constant_light = scene_of_size.constant_light
    write_truth(folder / "truth.npz", truth)
    trace, log = drive(folder, slot_us, rounds)

    def angle(recording: Recording) -> float:
        write_recording(folder / "events.h5", recording)
        options = fit.Options(
            scene, folder / "events.h5", truth=folder / "truth.npz", thresholds="known", define=define
        )
        return fit.recover(options).summary["mae_deg"]

    ring_deg = [angle(record_pins(signal, constant_light, trace, log, seed)) for seed in range(n_seed)]
    ideal_deg = [angle(record_ideal(signal, constant_light, log, seed)) for seed in range(n_seed)]
    return Errors(float(np.mean(ring_deg)), float(np.mean(ideal_deg)))
