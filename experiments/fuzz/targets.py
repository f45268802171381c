"""What is spoiled: a whole file of every kind that evsdr reads, and what reads it."""

import json
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import png

import evsdr
from evsdr.files.truth import write_truth
from experiments.fuzz import mutate
from tests.support.camera_files import encode_raw, random_recording, write_metavision

SIZE = 12  # width and height [pixels]
LEDS = "".join(
    f'<emitter type="directional" id="led_{j}"><vector name="direction" x="{x}" y="{y}" z="-1"/>'
    f'<spectrum name="irradiance" value="{nm - 20}:0, {nm}:0.05, {nm + 20}:0"/></emitter>\n'
    for j, (x, y, nm) in enumerate([(1, 0, 450), (0, 1, 620), (-1, 0, 450), (0, -1, 620), (0.5, 0.5, 620)])
)
SCENE = """<scene version="3.0.0">
<default name="light" value="0.05"/>
<integrator type="ring"><float name="constant_light" value="$light"/><integer name="max_depth" value="1"/></integrator>
<sensor type="orthographic" id="camera"><transform name="to_world"><scale x="1.4" y="1.4"/>
<lookat origin="0, 0, 4" target="0, 0, 0" up="0, 1, 0"/></transform>
<film type="hdrfilm"><integer name="width" value="12"/><integer name="height" value="12"/><rfilter type="box"/></film>
</sensor>
<include filename="rig.xml"/>
<bsdf type="diffuse" id="skin"><spectrum name="reflectance" value="430:0.3, 640:0.7"/></bsdf>
<shape type="ply" id="object"><string name="filename" value="object.ply"/><ref id="skin"/></shape>
<shape type="sphere" id="pole"><point name="center" x="0.9" y="0" z="0.8"/><float name="radius" value="0.1"/>
<bsdf type="diffuse"><texture type="bitmap" name="reflectance"><string name="filename" value="texture.png"/></texture>
</bsdf></shape>
</scene>
"""
PYRAMID = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0], [0, 0, 0.6]]
FACES = [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]


@dataclass(frozen=True)
class Target:
    """A file to spoil.

    Attributes
    ----------
    file : str
        Its name, in the folder of all.
    read : callable (Path)
        Reads the folder.
    spoil : callable (Path, Generator)
        Spoils the file.
    """

    file: str
    read: Callable[[Path], object]
    spoil: Callable[[Path, np.random.Generator], None]


def _with(change: Callable[[bytes, np.random.Generator], bytes]) -> Callable:
    return lambda path, rng: path.write_bytes(change(path.read_bytes(), rng))


def _member(path: Path, rng: np.random.Generator) -> None:
    """Spoil a member of an archive, its name, or the archive."""
    if rng.integers(3) == 0:
        return _with(mutate.spoil_bytes)(path, rng)
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    name = list(members)[rng.integers(len(members))]
    kind, data = rng.integers(4), members.pop(name)
    if kind == 0:
        members[mutate.spoil_text(name.encode(), rng).decode("latin-1").replace("\0", "") or "x"] = data
    elif kind == 1:
        members[name] = mutate.spoil_text(data[:128], rng) + data[128:]  # the header
    elif kind == 2:
        members[name] = mutate.spoil_bytes(data, rng)
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return None


def _render(folder: Path) -> object:
    scene = evsdr.load_scene(folder / "scene.xml")
    recording, truth = evsdr.simulate(scene, rounds=1, spp=1)
    return recording.events.t, truth.normal, truth.reflectance


def _fit(folder: Path) -> object:
    found = evsdr.fit(folder / "whole.xml", folder / "events.h5", evsdr.Settings(preset="fast"))
    return vars(found.maps)


def _convert(folder: Path, recording: str = "EVT2.raw", thresholds: str = "thresholds.npz") -> object:
    from evsdr.rig.join import read_sensor
    from evsdr.rig.log import read_ring_log
    from evsdr.rig.reader import read_camera_file

    read_ring_log(folder / "ring.json")
    read_camera_file(folder / recording)
    return read_sensor((SIZE, SIZE), None, folder / thresholds)


def _truth(folder: Path) -> object:
    from evsdr.files.truth import read_truth

    truth = read_truth(folder / "truth.npz", SIZE, SIZE, 2)
    return truth.normal[truth.mask], truth.reflectance[truth.mask]


def _maps(folder: Path) -> object:
    from evsdr.files.maps import read_maps

    return vars(read_maps(folder / "maps.npz"))


def _stack(folder: Path) -> object:
    from evsdr.files.photographs import read_stack

    return read_stack(folder / "stack.npz").frames


def _mask(name: str) -> Callable:
    def read(folder: Path) -> object:
        from evsdr.files.mask import read_mask

        return read_mask(folder / name, (SIZE, SIZE))

    return read


def _labels(folder: Path) -> object:
    from evsdr.calibration.reference import _read_labels

    return _read_labels(folder / "labels.npy", (SIZE, SIZE))


def _mesh(name: str) -> Callable:
    def read(folder: Path) -> object:
        from evsdr.calibration.pose import read_model

        return vars(read_model(folder / name, 1.0)[1])

    return read


def _points(folder: Path) -> object:
    from evsdr.calibration.pose import read_points

    return read_points(folder / "points.csv")


def _waveform(folder: Path) -> object:
    from evsdr.calibration.thresholds import log_waveform

    return log_waveform(str(folder / "waveform.csv"), 2.0)


def _spectra(folder: Path) -> object:
    from evsdr.calibration.chart import project, read_spectra

    density = np.exp(-(((np.arange(360.0, 830.5, 0.5) - 550) / 20) ** 2))
    return project(read_spectra(str(folder / "spectra.csv")), np.stack([density, density[::-1]])).value


def _patches(folder: Path) -> object:
    from evsdr.calibration.chart import read_patches

    return read_patches(folder / "patches.csv").value


def _summary(folder: Path) -> object:
    from evsdr.calibration.from_fit import from_fit

    return from_fit(folder, folder / "whole.xml", folder / "summary.json")


TEXT, BYTES = _with(mutate.spoil_text), _with(mutate.spoil_bytes)
TARGETS = (
    Target("scene.xml", _render, TEXT),
    Target("rig.xml", _render, TEXT),
    Target("object.ply", _render, TEXT),
    Target("texture.png", _render, BYTES),
    Target("events.h5", _fit, mutate.spoil_hdf5),
    Target("EVT2.raw", _convert, TEXT),
    Target("EVT21.raw", lambda folder: _convert(folder, "EVT21.raw"), BYTES),
    Target("EVT3.raw", lambda folder: _convert(folder, "EVT3.raw"), BYTES),
    Target("camera.h5", lambda folder: _convert(folder, "camera.h5"), BYTES),
    Target("camera.h5", lambda folder: _convert(folder, "camera.h5"), mutate.spoil_hdf5),
    Target("ring.json", _convert, TEXT),
    Target("thresholds.npz", _convert, _member),
    Target("thresholds.h5", lambda folder: _convert(folder, thresholds="thresholds.h5"), mutate.spoil_hdf5),
    Target("truth.npz", _truth, _member),
    Target("maps.npz", _maps, _member),
    Target("stack.npz", _stack, _member),
    Target("mask.png", _mask("mask.png"), BYTES),
    Target("mask.npy", _mask("mask.npy"), TEXT),
    Target("labels.npy", _labels, TEXT),
    Target("model.stl", _mesh("model.stl"), BYTES),
    Target("model.ply", _mesh("model.ply"), TEXT),
    Target("model.obj", _mesh("model.obj"), TEXT),
    Target("points.csv", _points, TEXT),
    Target("waveform.csv", _waveform, TEXT),
    Target("spectra.csv", _spectra, TEXT),
    Target("patches.csv", _patches, TEXT),
    Target("summary.json", _summary, TEXT),
)


def write_all(folder: Path) -> None:
    """Write a whole file of each kind."""
    import trimesh

    (folder / "scene.xml").write_text(SCENE)
    (folder / "rig.xml").write_text(f'<scene version="3.0.0">\n{LEDS}</scene>\n')
    (folder / "whole.xml").write_text(SCENE)
    mesh = trimesh.Trimesh(PYRAMID, FACES)
    mesh.export(folder / "object.ply", encoding="ascii")
    for kind in ("stl", "ply", "obj"):
        mesh.export(folder / f"model.{kind}")
    image = np.arange(3 * SIZE**2, dtype=np.uint8).reshape(SIZE, -1)
    png.from_array(image, "RGB").save(folder / "texture.png")
    png.from_array(np.uint8(image[:, :SIZE] % 2 * 255), "L").save(folder / "mask.png")
    recording, truth = evsdr.simulate(folder / "scene.xml", rounds=2, spp=1)
    evsdr.write_recording(folder / "events.h5", recording)
    _write_arrays(folder, truth)
    _write_texts(folder)
    _write_camera(folder)


def _write_arrays(folder: Path, truth) -> None:
    flat, bands = np.ones((SIZE, SIZE), np.float32), np.full((SIZE, SIZE, 2), 0.5, np.float32)
    np.save(folder / "mask.npy", flat > 0)
    np.save(folder / "labels.npy", np.arange(SIZE**2).reshape(SIZE, SIZE) % 4)
    np.savez(folder / "thresholds.npz", contrast_threshold_on=0.2 * flat, contrast_threshold_off=0.3)
    write_truth(folder / "truth.npz", truth)
    known = dict(mask=flat > 0, normal_sigma_deg=flat, reflectance_sigma=0.1 * bands)
    wave = np.float32([450, 620])
    np.savez(folder / "maps.npz", normal=truth.normal, reflectance=bands, band_wavelength_nm=wave, **known)
    frames = np.full((5, SIZE, SIZE), 0.5, np.float32)
    np.savez(folder / "stack.npz", frames=frames, light_direction=np.eye(5, 3) + 0.1, mask=flat > 0)


def _write_texts(folder: Path) -> None:
    nm = np.arange(380, 731, 10)
    rows = "".join(f"{n},{0.2 + n / 2000:.4f},{0.9 - n / 2000:.4f}\n" for n in nm)
    (folder / "spectra.csv").write_text(f"wavelength_nm,one,two\n{rows}")
    phase = np.linspace(0, 1, 20, endpoint=False)
    table = "".join(f"{p:.3f},{2 + np.sin(2 * np.pi * p):.4f}\n" for p in phase)
    (folder / "waveform.csv").write_text(table)
    points = "".join(f"{3 + x},{4 - y},{x},{y},{z}\n" for x, y, z in PYRAMID)
    (folder / "points.csv").write_text(f"x_pixel,y_pixel,X,Y,Z\n{points}")
    factor = {"power_factor": [1.0, 1.1, 0.9, 1.0, 1.2], "power_factor_sigma": [0.01] * 5}
    effects = {
        name: {"modelled": not k, "found": factor} for k, name in enumerate(("LED powers", "LED directions"))
    }
    (folder / "summary.json").write_text(json.dumps({"effects": effects}))
    log = {
        "format": "evsdr ring log", "version": 1, "firmware": "1.0", "order": [0, 2, -1, 1], "slot_us": 2500.0,
        "crossfade": 0.75, "rounds": 5, "rounds_done": 5, "trim": [1.0] * 24, "constant_light": True,
        "sync_slots": False, "started_utc": "2025-05-01T10:00:00Z", "log": [[0.0, "armed"]], "ended": "done",
    }  # fmt: skip
    (folder / "ring.json").write_text(json.dumps(log))


def _write_camera(folder: Path) -> None:
    """Write what cameras do: RAW of three kinds, and HDF5."""
    import h5py

    from evsdr.calibration.chart import PatchTable, write_patches

    camera = random_recording(np.random.default_rng(0), 400, 12)
    for kind in ("EVT2", "EVT21", "EVT3"):
        (folder / f"{kind}.raw").write_bytes(encode_raw(camera, kind))
    write_metavision(folder / "camera.h5", camera, 0, 100)
    with h5py.File(folder / "thresholds.h5", "w") as file:
        for name, value in (("on", 0.2), ("off", np.full((SIZE, SIZE), 0.3))):
            file[f"sensor/contrast_threshold_{name}"] = value
    half = np.full((2, 2), 0.5)
    write_patches(
        folder / "patches.csv", PatchTable(["a", "b"], np.array([1, 2]), np.array([450.0, 620.0]), half, half)
    )
