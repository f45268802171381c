"""The recordings of the benchmark: made once, with checksums, so that others can compare."""

import hashlib
import json
from dataclasses import asdict
from pathlib import Path
from typing import Literal

import numpy as np
from evsdr.scenes.formats import write_ply

import evsdr
from evsdr import EventPixel, Events, Recording, Schedule, Sensor

from .cases import (
    HALF_WIDTH,
    N_LED,
    REFRACTORY_US,
    ROUNDS,
    THRESHOLD,
    Case,
    led_directions,
    shape_of,
    texture,
)
from .event_maker import EPS, make_events

CONSTANT_LIGHT = 0.2  # C_w, of a white patch that faces an LED; makes as many bytes as the paper has
BYTES_PER_EVENT = 4  # of EVT 2.0
WHITE_ROUNDS = 3  # of the two-stage pipeline: half of the time for normals, half for spectra
SHOT_LEDS = np.arange(0, N_LED, 3)  # one of each band, evenly around
SHOT_BYTES = 256  # of frames per pixel: 16 MiB at 256 x 256
BYTES_PER_SAMPLE, FULL_WELL, READ_NOISE = 2, 10_000, 3.0  # of the frame camera; electrons

Pixel = Literal["paper", "ours"]


def make(case: Case, folder: Path, size: int, pixel: Pixel = "paper") -> None:
    """Render a case, and write all that the methods get into a folder.

    Parameters
    ----------
    pixel : str
        Who makes the events of the ring: `event_maker`, as the paper's simulator, or the pixel of `evsdr.simulate`.
        What the baselines get is made of the paper's ring alone.
    """
    from .render import render  # late: it imports Mitsuba

    folder.mkdir(parents=True, exist_ok=True)
    reflectance = texture(case)
    write_ply(folder / "object.ply", shape_of(case))
    frames = render(case, folder / "object.ply", reflectance, size)
    (folder / "scene.xml").write_text(scene_xml(case, size))
    recording = watch_ring(case, frames.ring, pixel)
    evsdr.write_recording(folder / "events.h5", recording)
    true = {"normal": frames.normal, "reflectance": frames.reflectance, "mask": frames.mask}
    np.savez_compressed(folder / "truth.npz", **true)
    if not case.is_rainbow:
        np.savez_compressed(folder / "two_stage.npz", **watch_stages(case, frames.white, frames.frontal))
        np.savez_compressed(folder / "frames.npz", image=shoot(case, frames.ring[SHOT_LEDS]))
    (folder / "case.json").write_text(json.dumps(asdict(case), indent=1) + "\n")


def watch_ring(case: Case, signal: np.ndarray, pixel: Pixel) -> Recording:
    """Let event pixels watch the ring."""
    n_led, height, width = signal.shape
    order = np.arange(n_led, dtype=np.int32)
    schedule = Schedule(order, case.slot_us, 1.0)
    starts = np.int64(case.slot_us * n_led) * np.arange(ROUNDS + 1)
    if pixel == "ours":
        own = EventPixel(
            THRESHOLD, THRESHOLD, event_noise=case.noise, refractory_us=REFRACTORY_US
        ).idealised()
        events = evsdr.record(signal, CONSTANT_LIGHT + EPS, own, schedule, ROUNDS, case.number).events
    else:
        sensor = THRESHOLD, case.noise, REFRACTORY_US, seed_of(case, 0)
        events = make_events(signal, CONSTANT_LIGHT, order, case.slot_us, ROUNDS, *sensor)
    told = case.told * THRESHOLD
    return Recording(events, Sensor(width, height, told, told, REFRACTORY_US), schedule, starts)


def watch_stages(case: Case, white: np.ndarray, frontal: np.ndarray) -> dict[str, np.ndarray]:
    """Let event pixels watch white light go round, then the bands in turn from the front after a dark slot."""
    half_us = 0.5e6 * case.seconds / WHITE_ROUNDS
    sensor = THRESHOLD, case.noise, REFRACTORY_US
    stages = {
        "normal": (white, 0.0, np.arange(len(white))),
        "spectrum": (frontal, CONSTANT_LIGHT, np.arange(-1, len(frontal))),
    }
    out = {}
    for i, (stage, (signal, constant, order)) in enumerate(stages.items()):
        slot_us = half_us / len(order)
        e = make_events(signal, constant, order, slot_us, WHITE_ROUNDS, *sensor, seed_of(case, 1 + i))
        out |= {f"{stage}_{name}": getattr(e, name) for name in "xypt"}
        out |= {f"{stage}_order": order, f"{stage}_slot_us": slot_us}
    return out


def shoot(case: Case, signal: np.ndarray) -> np.ndarray:
    """Photograph all bands at once, each lit from its own side; the mean (n_band, H, W) of as many shots as fit."""
    n_shot = SHOT_BYTES // (BYTES_PER_SAMPLE * len(signal))
    rng = np.random.default_rng(seed_of(case, 3))
    electrons = FULL_WELL * np.broadcast_to(signal, (n_shot, *signal.shape))
    noisy = rng.poisson(electrons) + READ_NOISE * rng.standard_normal(electrons.shape)
    return (np.round(noisy).mean(axis=0) / FULL_WELL).astype(np.float32)


def seed_of(case: Case, stream: int) -> int:
    """Seed one stream of noise of a case."""
    return int(np.random.SeedSequence([*case.seed, case.bases, stream]).generate_state(1)[0] >> 8)


def read_events(folder: Path, stage: str) -> tuple[Events, np.ndarray, float]:
    """Read the events of a stage of the two-stage pipeline, the order of its lights, and the length of a slot [us]."""
    with np.load(folder / "two_stage.npz") as data:
        events = Events(*(data[f"{stage}_{name}"] for name in "xypt"))
        return events, data[f"{stage}_order"], float(data[f"{stage}_slot_us"])


def checksums(folder: Path) -> str:
    """List the SHA-256 of all that methods read, as `sha256sum` does."""
    files = sorted(f for f in folder.rglob("*") if f.suffix in (".xml", ".h5", ".npz"))
    return "".join(f"{hashlib.sha256(f.read_bytes()).hexdigest()}  {f.relative_to(folder)}\n" for f in files)


def scene_xml(case: Case, size: int) -> str:
    """Write what a fit is told: camera, LEDs, constant light; a rectangle stands for the unknown shape."""
    parts = [
        f'<integrator type="ring"><float name="constant_light" value="{CONSTANT_LIGHT + EPS:g}"/></integrator>',
        f"""<sensor type="orthographic" id="camera">
        <transform name="to_world">
            <scale x="{HALF_WIDTH}" y="{HALF_WIDTH}"/><lookat origin="0, 0, 10" target="0, 0, 0" up="0, 1, 0"/>
        </transform>
        <film type="hdrfilm">
            <integer name="width" value="{size}"/><integer name="height" value="{size}"/><rfilter type="box"/>
        </film>
    </sensor>""",
    ]
    for j, (x, y, z) in enumerate((-led_directions(case.polar_deg, case.n_led)).round(7).tolist()):
        nm = case.band_nm[j % len(case.band_nm)]
        parts.append(
            f'<emitter type="directional" id="led_{j:02d}"><vector name="direction" x="{x}" y="{y}" z="{z}"/>'
            f'<spectrum name="irradiance" value="{nm - 5}:0, {nm}:0.2, {nm + 5}:0"/></emitter>'
        )
    half = f'<transform name="to_world"><scale value="{HALF_WIDTH}"/></transform>'
    parts.append(f'<shape type="rectangle" id="object">{half}<bsdf type="diffuse"/></shape>')
    return '<scene version="3.0.0">\n    ' + "\n    ".join(parts) + "\n</scene>\n"
