"""What is recorded, and what a fit is told of it: scenes, sensors, and the pairs of both."""

from dataclasses import dataclass
from functools import cache

import numpy as np

from evsdr import EventPixel, Recording, Schedule, Sensor, Truth, simulate
from evsdr.fitting.simulation import render
from tests.support.foreign_pixel import watch
from tests.support.foreign_recordings import EVK4_LIKE, as_recording

from ..colour_chart.compute import order_with_pauses
from ..shared.compute import altered

N_LED, N_ROUND, SLOT_US = 24, 6, 20_000.0
CONSTANT_LIGHT = 0.05
POWERS_OFF = 0.1  # standard deviation of the log power of an LED, within its band
SPP = 16  # rays per pixel


def scene_text(shape: str, surface: str) -> str:
    """Write a scene beside the files of `scenes/`; `surface` is a BSDF with the id `surface`."""
    return f"""<scene version="3.0.0">
    <default name="constant_light" value="{CONSTANT_LIGHT}"/>
    <integrator type="ring"><float name="constant_light" value="$constant_light"/></integrator>
    <include filename="camera.xml"/>
    <include filename="ring24.xml"/>
    {surface}
    {shape}
</scene>
"""


def mesh(name: str) -> str:
    """Write the object as a mesh of `scenes/`."""
    return f'<shape type="ply" id="object"><string name="filename" value="{name}.ply"/><ref id="surface"/></shape>'


def plain(reflectance: str, attributes: str = 'id="surface"') -> str:
    """Write a matt surface of one spectrum."""
    return f'<bsdf type="diffuse" {attributes}><spectrum name="reflectance" value="{reflectance}"/></bsdf>'


def tiles(first: str, second: str) -> str:
    """Write a matt surface of square tiles of two spectra, five pixels each in 32 x 32."""
    return f"""<bsdf type="blendbsdf" id="surface">
        <texture type="checkerboard" name="weight">
            <float name="color0" value="0"/><float name="color1" value="1"/>
            <transform name="to_uv"><scale x="7" y="3.5"/></transform>
        </texture>
        {plain(first, "")}{plain(second, "")}
    </bsdf>"""


BALL = '<shape type="sphere" id="object"><ref id="surface"/></shape>'
FILES = {
    "texture.xml": scene_text(mesh("blob"), tiles("360:0.2, 500:0.5, 830:0.7", "360:0.6, 500:0.3, 830:0.2")),
    "dark_texture.xml": scene_text(mesh("blob"), tiles("0.03", "0.5")),
    "white_ball.xml": scene_text(BALL, plain("0.8")),
    "grey_relief.xml": scene_text(mesh("relief"), plain("0.4")),
}


@dataclass(frozen=True)
class Scene:
    """What is before the camera.

    Attributes
    ----------
    name : str
        For the table.
    file, told : str
        Scene file that is recorded, and that a fit is told: a rectangle where the shape is unknown.
    white : bool
        Whether all LEDs have one spectrum.
    order : tuple of int
        LED of each slot, -1 for none.
    slot_us : float
    rounds : int
    """

    name: str
    file: str
    told: str
    white: bool = False
    order: tuple[int, ...] = tuple(range(N_LED))
    slot_us: float = SLOT_US
    rounds: int = N_ROUND

    @property
    def schedule(self) -> Schedule:
        return Schedule(np.array(self.order, np.int32), self.slot_us, 1.0)


@dataclass(frozen=True)
class Camera:
    """What records it, and how well its rig is told.

    Attributes
    ----------
    name : str
    pixel : EventPixel, optional
        The other event pixel, of `tests/support`, by default.
    power : float
        By which the log powers that are told are off, within their bands: one standard deviation.
    """

    name: str
    pixel: EventPixel | None = None
    power: float = 0.0


SCENES = (
    Scene("sphere", "sphere", "sphere"),
    Scene("relief", "relief", "relief_unknown"),
    Scene("texture", "texture", "texture"),
    Scene("chart", "colorchecker", "colorchecker", order=order_with_pauses(N_LED)),
    Scene("plain_chart", "colorchecker", "colorchecker"),
    Scene("white_ball", "white_ball", "white_ball"),
    Scene("grey_relief", "grey_relief", "relief_unknown"),
    Scene("slow_circle", "sphere", "sphere", white=True, slot_us=200_000.0, rounds=2),
    Scene("dark_texture", "dark_texture", "dark_texture"),
)
CAMERAS = (
    Camera("ideal", EventPixel(event_noise=0.1).idealised()),
    Camera("evk4", EventPixel()),
    Camera("powers", EventPixel(), POWERS_OFF),
    Camera("foreign"),
)


@dataclass(frozen=True)
class Case:
    """A row of the table: a scene and what records it."""

    scene: Scene
    camera: Camera

    @property
    def name(self) -> str:
        return f"{self.scene.name}/{self.camera.name}"


CASES = tuple(Case(scene, camera) for scene in SCENES for camera in CAMERAS)


def chosen(names: str) -> list[Case]:
    """Give the cases of a list of names, as `sphere/evk4`, of scenes, or of cameras, with commas between; all of none.

    Raises
    ------
    ValueError
        There is none of that name.
    """
    if not names:
        return list(CASES)
    known = {word for case in CASES for word in (case.name, case.scene.name, case.camera.name)}
    wanted = names.split(",")
    for name in wanted:
        if name not in known:
            raise ValueError(f"there is no case {name!r}; name some of {', '.join(sorted(known))}")
    return [case for case in CASES if {case.name, case.scene.name, case.camera.name} & set(wanted)]


@cache
def load(file: str, white: bool, size: int, constant_light: float = CONSTANT_LIGHT):
    """Load a scene as it is."""
    return tell(file, white, size, constant_light, np.zeros(N_LED))


def tell(file: str, white: bool, size: int, constant_light: float, log_power: np.ndarray):
    """Load a scene that tells the powers of its LEDs off by factors (n_led,)."""

    def power(j: int, spectrum: np.ndarray) -> np.ndarray:
        return np.exp(log_power[j]) * spectrum

    return altered(
        file, size, white, power, lambda j, direction: direction, FILES, constant_light=constant_light
    )


def make(case: Case, size: int, seed: int) -> tuple[object, Recording, Truth]:
    """Give the scene as a fit is told of it, a recording that tells thresholds as one value, and the truth."""
    scene, camera = case.scene, case.camera
    if camera.pixel is None:
        return make_foreign(scene, size, seed)
    recorded = load(scene.file, scene.white, size)
    recording, truth = simulate(
        recorded, camera.pixel, scene.schedule, scene.rounds, seed, thresholds="nominal", spp=SPP
    )
    if camera.power == 0:
        return load(scene.told, scene.white, size), recording, truth
    band = recorded.leds.band
    log_power = camera.power * np.random.default_rng([seed, 2]).normal(size=N_LED)
    log_power -= (np.bincount(band, log_power) / np.bincount(band))[band]  # no recording tells a band's gain
    return tell(scene.told, scene.white, size, CONSTANT_LIGHT, log_power), recording, truth


def make_foreign(scene: Scene, size: int, seed: int) -> tuple[object, Recording, Truth]:
    """Do the same with the other event pixel, whose dark current is told as constant light."""
    pixel, schedule = EVK4_LIKE, scene.schedule
    signal, truth = render(load(scene.file, scene.white, size), SPP, seed)
    plan = schedule.order, schedule.slot_us, schedule.crossfade, scene.rounds
    events = watch(signal, CONSTANT_LIGHT, *plan, pixel, seed)
    sensor = Sensor(size, size, pixel.on, pixel.off, pixel.refractory_us)
    told = load(scene.told, scene.white, size, CONSTANT_LIGHT + pixel.dark_light)
    return told, as_recording(events, sensor, schedule), truth
