"""What is drawn, and the scene files of it: the true one, and the one that a fit is told."""

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from shutil import copytree, ignore_patterns
from tempfile import TemporaryDirectory

import numpy as np
from evsdr.scenes.make_rigs import BANDS

import evsdr

from evsdr.rig.led_light import led_spectrum
from evsdr.rig.led_xml import far_led, near_led, spectrum_xml, square_led

from ..cast_shadow.compute import MESHES, SCENES, data_folder, write_scaled_mesh
from ..sigma.cases import plain

OUT = SCENES.parent / "out" / "draws"
N_LED, N_BAND = 24, 8
DISTANCE, WIDTH = 3.5, 0.4  # of near LEDs from the origin, and of square ones; in object radii
PIXELS = ("evk4", "evk4_like", "iebcs", "v2e", "eventps", "esim")  # the first is ours
SHAPES = ("sphere", "cylinder", "plane", "blob", "relief", *MESHES)
MATERIALS = ("matt", "texture", "tiles", "gloss", "white", "grey")
PERSPECTIVE = """<sensor type="perspective" id="camera"><float name="fov" value="26"/>
    <transform name="to_world"><lookat origin="0, 0, 5" target="0, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="$size"/><integer name="height" value="$size"/>
        <rfilter type="box"/></film></sensor>"""
CAMERA = '<include filename="camera.xml"/>'
UNKNOWN = """<shape type="rectangle" id="object"><transform name="to_world"><scale value="1.2"/></transform>
    </shape>"""


@dataclass(frozen=True)
class Draw:
    """One draw.

    Attributes
    ----------
    seed : int
        Of it and of its recording.
    shape, material, leds, pixel : str
        Of `SHAPES` and `MATERIALS`; `far`, `near` or `soft`; of `PIXELS`.
    known, perspective, pauses : bool
        Whether the shape is told; whether there is a dark slot before every third LED.
    polar_deg, constant_light, slot_us, crossfade : float
    rounds : int
    on, off, event_noise, refractory_us : float
        Of pixels that have no figures of their own.
    power : float
        By which log powers are told wrong, one standard deviation.
    told_threshold, told_refractory : float
        Factors of what is told.
    """

    seed: int
    shape: str
    material: str
    leds: str
    pixel: str
    known: bool
    perspective: bool
    pauses: bool
    polar_deg: float
    constant_light: float
    slot_us: float
    crossfade: float
    rounds: int
    on: float
    off: float
    event_noise: float
    refractory_us: float
    power: float
    told_threshold: float
    told_refractory: float

    @property
    def order(self) -> np.ndarray:
        """LED of each slot; -1 for none."""
        order = np.arange(N_LED, dtype=np.int32)
        return np.insert(order, np.arange(0, N_LED, 3), -1) if self.pauses else order

    @property
    def log_power(self) -> np.ndarray:
        """What LEDs are brighter than told (n_led,), without what all of a band have in common."""
        off = self.power * np.random.default_rng([self.seed, 1]).standard_normal((N_LED // N_BAND, N_BAND))
        return (off - off.mean(axis=0)).ravel()

    def __str__(self) -> str:
        words = [self.shape, "known" if self.known else "unknown", self.material, self.leds, self.pixel]
        words += [
            f"{self.slot_us / 1000:.3g} ms x {self.rounds}",
            f"fade {self.crossfade:g}",
            f"C_w {self.constant_light:.2g}",
        ]
        words += ["dark slots"] * self.pauses + ["perspective"] * self.perspective
        words += [f"powers {self.power:g}"] * (self.power > 0)
        return ", ".join(words)


def draw(seed: int) -> Draw:
    """Draw everything; meshes only where they are present."""
    rng = np.random.default_rng(seed)

    def log_uniform(low, high):
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    def one_of(values, share=None):
        return values[rng.choice(len(values), p=share)]

    there = [s for s in SHAPES if s not in MESHES or (data_folder() / MESHES[s]).is_file()]
    on = float(rng.uniform(0.1, 0.35))
    return Draw(
        seed,
        shape=one_of(there),
        material=one_of(MATERIALS),
        leds=one_of(("far", "near", "soft"), (0.6, 0.25, 0.15)),
        pixel=one_of(PIXELS, (0.45, 0.2, 0.1, 0.1, 0.1, 0.05)),
        known=bool(rng.random() < 0.35),
        perspective=bool(rng.random() < 0.25),
        pauses=bool(rng.random() < 0.35),
        polar_deg=float(rng.uniform(25, 60)),
        constant_light=log_uniform(0.01, 0.15),
        slot_us=log_uniform(1500, 60_000),
        crossfade=one_of((0.0, 0.3, 1.0), (0.15, 0.15, 0.7)),
        rounds=int(rng.integers(2, 9)),
        on=on,
        off=float(on * rng.uniform(0.8, 1.6)),
        event_noise=one_of((0.02, 0.05, 0.1, 0.2)),
        refractory_us=log_uniform(10, 800),
        power=one_of((0.0, 0.05, 0.1), (0.5, 0.25, 0.25)),
        told_threshold=one_of((1.0, 0.9, 1.15), (0.5, 0.25, 0.25)),
        told_refractory=one_of((1.0, 1.2), (0.65, 0.35)),
    )


def scene_text(case: Draw, told: bool, dark_light: float = 0.0) -> str:
    """Write the scene beside the files of `scenes/`; as a fit is told it, or as it is.

    To a pixel with a dark current that is constant light, and told as such.
    """
    veil = case.constant_light + dark_light * told
    unknown = told and not case.known
    parts = [
        f'<integrator type="ring"><float name="constant_light" value="{veil:.6g}"/></integrator>',
        PERSPECTIVE if case.perspective else CAMERA,
        ring_text(case, np.zeros(N_LED) if told else case.log_power),
        surface_text(case),
        UNKNOWN if unknown else shape_text(case),
    ]
    defaults = '<default name="size" value="40"/><default name="bases" value="3"/>'
    return f'<scene version="3.0.0">{defaults}{"".join(parts)}</scene>'


def open_text(text: str, size: int):
    """Load a scene that lies beside the files of `scenes/`."""
    with TemporaryDirectory() as folder:
        copytree(SCENES, folder, dirs_exist_ok=True, ignore=ignore_patterns("*.py", "__pycache__"))
        path = Path(folder) / "draw.xml"
        path.write_text(text)
        return evsdr.load_scene(path, size=size)


def ring_text(case: Draw, log_power: np.ndarray) -> str:
    """Write the LEDs, each with a spectrum of its own power."""
    azimuth, polar = 2 * np.pi * np.arange(N_LED) / N_LED, np.deg2rad(case.polar_deg)
    direction = np.sin(polar) * np.stack(
        [np.cos(azimuth), np.sin(azimuth), np.full(N_LED, 1 / np.tan(polar))], 1
    )
    scale = {"far": 1.0, "near": DISTANCE**2, "soft": (DISTANCE / WIDTH) ** 2}[case.leds]
    lines = []
    for j, to_light in enumerate(direction):
        wavelength_nm, irradiance = led_spectrum(*BANDS[j % N_BAND])
        lines.append(spectrum_xml(wavelength_nm, scale * np.exp(log_power[j]) * irradiance, id=f"light_{j}"))
        named, place = (f"led_{j:02d}", f"light_{j}"), DISTANCE * to_light
        led = {
            "far": lambda: far_led(*named, to_light),
            "near": lambda: near_led(*named, place),
            "soft": lambda: square_led(*named, place, WIDTH),
        }[case.leds]
        lines.append(led())
    return "\n".join(lines)


def surface_text(case: Draw) -> str:
    """Write the material."""
    rng = np.random.default_rng([case.seed, 2])

    def spectrum(low, high):
        nodes = zip((360, 450, 520, 580, 650, 830), rng.uniform(low, high, 6))
        return ", ".join(f"{wavelength}:{value:.3f}" for wavelength, value in nodes)

    match case.material:
        case "texture":
            return f'<include filename="bases_{rng.choice((1, 3, 8))}.xml"/>'
        case "tiles":
            both = plain(spectrum(0.1, 0.6), "") + plain(spectrum(0.03, 0.3), "")
            return f"""<bsdf type="blendbsdf" id="surface"><texture type="checkerboard" name="weight">
                <float name="color0" value="0"/><float name="color1" value="1"/>
                <transform name="to_uv"><scale x="7" y="3.5"/></transform></texture>{both}</bsdf>"""
        case "gloss":
            return f"""<bsdf type="principled" id="surface"><float name="specular" value="0.5"/>
                <spectrum name="base_color" value="{spectrum(0.1, 0.6)}"/>
                <float name="roughness" value="{rng.uniform(0.3, 0.6):.2f}"/></bsdf>"""
        case "white":
            return plain("0.85")
        case "grey":
            return plain("0.2")
    return plain(spectrum(0.15, 0.7))


def shape_text(case: Draw) -> str:
    """Write the object."""
    rng, surface = np.random.default_rng([case.seed, 3]), '<ref id="surface"/>'
    match case.shape:
        case "sphere":
            return f'<shape type="sphere" id="object">{surface}</shape>'
        case "cylinder":
            return f"""<shape type="cylinder" id="object"><float name="radius" value="0.6"/>{surface}
                <point name="p0" x="-0.9" y="-0.3" z="0"/>
                <point name="p1" x="0.9" y="0.3" z="0.2"/></shape>"""
        case "plane":
            axis, angle = rng.normal(size=2), rng.uniform(0, 60)
            turn = f'<rotate x="{axis[0]:.2f}" y="{axis[1]:.2f}" z="0" angle="{angle:.1f}"/>'
            return f"""<shape type="rectangle" id="object"><transform name="to_world">{turn}</transform>
                {surface}</shape>"""
    file = scaled_mesh(case.shape) if case.shape in MESHES else f"{case.shape}.ply"
    return f'<shape type="ply" id="object"><string name="filename" value="{file}"/>{surface}</shape>'


@cache
def scaled_mesh(name: str) -> Path:
    """Write a mesh where results go."""
    return write_scaled_mesh(data_folder() / MESHES[name], OUT / f"{name.replace(' ', '_')}.ply")
