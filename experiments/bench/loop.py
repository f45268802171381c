"""From the host's command through firmware, pins, light and events to a normal map."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import evsdr
from evsdr import EventPixel, Events, Recording, Schedule, Sensor, Settings, Truth
from evsdr.calibration.thresholds import thresholds
from evsdr.fitting.simulation import render
from evsdr.rig.driver import Ring, RingSettings, flickering
from evsdr.rig.log import RingLog, read_ring_log, write_ring_log
from experiments.bench.light import FULL, Trace, read_trace
from experiments.bench.simulator import beside_host
from experiments.bench.vcd import CYCLES_PER_US, N_LED, mean_light

KNOTS = 12_000  # at most, between which the measured light is linear
KNOT_US = 80  # five periods of the carrier, over which it is averaged; longer where KNOTS are too few
CAMERA_US = 12_345  # the camera's clock at the start of the first round
IDEAL = EventPixel(0.25, 0.25).idealised()
PLAIN = RingSettings(slot_us=10_000, rounds=4)
TRIMMED = replace(PLAIN, trim=tuple({3: 0.25, 10: 0.6}.get(led, 1.0) for led in range(N_LED)))
FLICKER_ROUNDS = 6
SHEET = 10.0  # times the constant light, what an LED lights of the sheet that the flicker is recorded on


@dataclass(frozen=True)
class Errors:
    """Mean angle between recovered and true normals [deg].

    Attributes
    ----------
    ring_deg : float
        By the ring's pins.
    ideal_deg : float
        By an ideal schedule.
    untold_deg : float
        By the ring's pins, where the recording does not tell how bright each LED was; NaN where all were as bright.
    """

    ring_deg: float
    ideal_deg: float
    untold_deg: float = np.nan


@dataclass(frozen=True)
class FlickerErrors:
    """What thresholds by the ring's flicker are worth.

    Attributes
    ----------
    on, off : float
        Root mean square of the relative error of C_on and C_off, by the flicker.
    nominal_on, nominal_off : float
        As told by one value.
    measured_deg, nominal_deg, true_deg : float
        Mean angle between recovered and true normals, with the thresholds of the flicker, one value, and the true ones.
    """

    on: float
    off: float
    nominal_on: float
    nominal_off: float
    measured_deg: float
    nominal_deg: float
    true_deg: float


def drive(folder: Path, settings: RingSettings) -> tuple[Trace, RingLog]:
    """Let the host run the ring on the bench; leaves pins.vcd and ring.json in the folder."""
    with beside_host(folder / "pins.vcd") as (port, _), Ring(port) as ring:
        log = ring.run(settings)
    write_ring_log(folder / "ring.json", log)
    return read_trace(folder / "pins.vcd"), read_ring_log(folder / "ring.json")


def record_pins(
    signal: np.ndarray,
    constant_light: float,
    trace: Trace,
    log: RingLog,
    seed: int = 0,
    pixel: EventPixel = IDEAL,
) -> Recording:
    """Give what the camera records of the light that the pins tell.

    Between knots the light is linear: to the simulator each knot is an LED of its own.
    """
    n_led = len(signal)
    first, last = trace.rounds[0], trace.rounds[-1]
    length_us = (last - first) / CYCLES_PER_US
    knot_us = KNOT_US * np.ceil(length_us / KNOTS / KNOT_US)
    n_knot = int(length_us / knot_us) + 1
    edge = first + (np.arange(n_knot + 1) - 0.5) * knot_us * CYCLES_PER_US
    edge = np.clip(edge, first, last)  # the camera sees the run, and nothing before and after it
    weight = np.column_stack([mean_light(trace.pulses[led % 2], led, edge) / FULL for led in range(N_LED)])
    knots = np.tensordot(weight[:, :n_led], signal, axes=1)
    schedule = Schedule(np.arange(n_knot), knot_us, 1.0, CAMERA_US)
    recording = evsdr.record(knots, constant_light, pixel, schedule, 1, seed)
    events = recording.events
    real = events.t < CAMERA_US + (n_knot - 1) * knot_us  # then the simulator starts over
    events = Events(events.x[real], events.y[real], events.p[real], events.t[real])
    triggers = np.rint((trace.rounds - first) / CYCLES_PER_US).astype(np.int64) + CAMERA_US
    asked = Schedule(log.order, log.slot_us, log.crossfade, trim=log.trim)
    return Recording(events, recording.sensor, asked, triggers)


def record_ideal(
    signal: np.ndarray, constant_light: float, log: RingLog, seed: int = 0, pixel: EventPixel = IDEAL
) -> Recording:
    """Give what the camera records of the schedule itself."""
    schedule = Schedule(log.order, log.slot_us, log.crossfade, CAMERA_US, log.trim)
    return evsdr.record(signal, constant_light, pixel, schedule, log.n_round, seed)


def close_loop(
    folder: Path,
    file: Path,
    size: int,
    settings: RingSettings = PLAIN,
    n_seed: int = 3,
    preset: str = "balanced",
) -> Errors:
    """Run the ring, record a scene under it, fit the events; the same with an ideal schedule.

    The means are over `n_seed` draws of the pixels' noise.
    """
    scene = evsdr.load_scene(file, size=size)
    signal, truth = render(scene)
    trace, log = drive(folder, settings)
    asked, light = Settings(preset=preset, thresholds="known"), scene.constant_light
    rings = [record_pins(signal, light, trace, log, seed) for seed in range(n_seed)]
    ideal = [record_ideal(signal, light, log, seed) for seed in range(n_seed)]
    silent = [replace(one, schedule=replace(one.schedule, trim=None)) for one in rings]

    def angle(recordings: list[Recording]) -> float:
        return float(np.mean([_angle(scene, truth, recording, asked) for recording in recordings]))

    return Errors(angle(rings), angle(ideal), angle(silent) if min(settings.trim) < 1 else np.nan)


def close_flicker_loop(folder: Path, file: Path, size: int, preset: str = "balanced") -> FlickerErrors:
    """Let the ring flicker before a white sheet, measure thresholds, fit a scene with them; the pixels are an EVK4's."""
    scene, pixel = evsdr.load_scene(file, size=size), EventPixel()
    signal, truth = render(scene)
    light = scene.constant_light
    sheet = np.full((1, *signal.shape[1:]), SHEET * light)
    trace, log = drive(folder, replace(flickering(PLAIN), rounds=FLICKER_ROUNDS))
    seen = evsdr.record(signal, light, pixel, _schedule_of(PLAIN), PLAIN.rounds)
    evsdr.write_recording(folder / "flicker.h5", record_pins(sheet, light, trace, log, pixel=pixel))
    evsdr.write_recording(folder / "ring.h5", seen)
    (folder / "thresholds").mkdir()
    thresholds(folder / "thresholds", folder / "flicker.h5", "ring", apply=(folder / "ring.h5",))
    measured = evsdr.read_recording(folder / "thresholds" / "ring.h5")
    nominal = replace(
        seen.sensor,
        contrast_threshold_on=pixel.contrast_threshold_on,
        contrast_threshold_off=pixel.contrast_threshold_off,
    )

    def errors(sensor: Sensor) -> tuple[float, float]:
        names = "contrast_threshold_on", "contrast_threshold_off"
        off = (getattr(sensor, name) / getattr(seen.sensor, name) - 1 for name in names)
        return tuple(float(np.sqrt(np.mean(value**2))) for value in off)

    recordings = measured, replace(seen, sensor=nominal), seen
    angles = (_angle(scene, truth, recording, Settings(preset=preset)) for recording in recordings)
    return FlickerErrors(*errors(measured.sensor), *errors(nominal), *angles)


def _schedule_of(settings: RingSettings) -> Schedule:
    return Schedule(np.array(settings.order, np.int32), settings.slot_us, settings.crossfade)


def _angle(scene, truth: Truth, recording: Recording, settings: Settings) -> float:
    return evsdr.score(evsdr.fit(scene, recording, settings).maps, truth)["mae_deg"]
