"""Recordings of one scene under many settings: what is recovered, and what could be at best.

Import once a scene is loaded, or after `evsdr.jit.start()`.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import evsdr
from evsdr import EventPixel, InputError, Maps, Recording, Settings, Truth
from evsdr.events.pairs import pair_events
from evsdr.events.record import record as record_light
from evsdr.limits.bound import Limit
from evsdr.limits.information import Plan, pixels_of, theta_of
from evsdr.limits.judge import Rendering, limit_of, render_object
from evsdr.model.lambert import LambertianRing
from evsdr.solve import loop, recipes
from evsdr.solve.problem import make_problem
from evsdr.solve.shared.rig import Told
from evsdr.solve.unknowns import first_theta, to_normal

from .errors import compare, shares_within

SCENES = Path(__file__).resolve().parents[2] / "scenes"
SPP = 16  # rays per pixel of the images, and for visibility
OWN = "own light"  # in place of a preset: see `recover_own_light`
TOLD = Told(directions_deg=0.0)  # as a fit takes it by default


@dataclass(frozen=True)
class Setting:
    """What a recording is made with; the defaults are the base case.

    Attributes
    ----------
    constant_light : float
        C_w, in units of a white patch that faces an LED.
    threshold_on, threshold_off : float
        Contrast thresholds [natural log].
    noise : float
        Relative standard deviation of the thresholds from event to event.
    rounds : int
        Rounds of the ring.
    evk4 : bool
        An EVK4 with all its defects, that tells one value for all thresholds, instead of all but the rounds and C_w.
    """

    constant_light: float = 0.05
    threshold_on: float = 0.2525
    threshold_off: float = 0.3795
    noise: float = 0.1
    rounds: int = 6
    evk4: bool = False

    def pixel(self) -> EventPixel:
        """Give the event pixel: ideal but for event noise and refractory period, or an EVK4."""
        if self.evk4:
            return EventPixel()
        return EventPixel(self.threshold_on, self.threshold_off, event_noise=self.noise).idealised()


BASE = Setting()
EVK4 = Setting(evk4=True)
SWEEPS = {
    "constant light": [
        (c, replace(BASE, constant_light=c)) for c in (0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5)
    ],
    "threshold": [(c, replace(BASE, threshold_on=c, threshold_off=c)) for c in (0.05, 0.1, 0.2, 0.5)],
    "noise": [(s, replace(BASE, noise=s)) for s in (0.02, 0.05, 0.1, 0.2)],
    "rounds": [(n, replace(BASE, rounds=n)) for n in (1, 2, 6, 24)],
}


@dataclass(frozen=True)
class Rendered:
    """A scene, rendered once for all its settings.

    Attributes
    ----------
    name : str
        Of the scene file.
    size : int
        Width and height [pixels].
    object : Rendering
        Its object under the ring.
    """

    name: str
    size: int
    object: Rendering

    @property
    def truth(self) -> Truth:
        """What is true of the object."""
        maps = self.object.truth
        return Truth(maps.normal, maps.reflectance, maps.mask)

    def scene(self, setting: Setting):
        """Load the scene with the constant light of a setting."""
        return load(self.name, self.size, setting.constant_light)


def load(name: str, size: int, constant_light: float = BASE.constant_light):
    """Load a scene of `scenes/`."""
    return evsdr.load_scene(SCENES / f"{name}.xml", size=size, constant_light=constant_light)


def render(name: str, size: int, seed: int = 0) -> Rendered:
    """Render the LED images and the truth of a scene of `scenes/`, trace its light."""
    return Rendered(name, size, render_object(load(name, size), SPP, seed))


def led_signal(rendered: Rendered) -> float:
    """Give the median signal of an LED that lights a pixel, over the pixels of the truth."""
    signal = rendered.object.signal[:, rendered.truth.mask]
    return float(np.median(signal[signal > 0]))


def record(rendered: Rendered, setting: Setting, seed: int = 0) -> Recording:
    """Simulate a recording, as `evsdr.simulate` does; an ideal pixel tells its thresholds."""
    scene = rendered.scene(setting)
    given = {"rounds": setting.rounds, "seed": seed, "spp": SPP, "thresholds": "nominal"}
    return evsdr.simulate(scene, setting.pixel(), **given)[0]


def recover(rendered: Rendered, setting: Setting, recording: Recording, preset: str, priors: bool) -> Maps:
    """Fit a recording; of an ideal pixel as `evsdr.fit --thresholds known` does, without a look for what it doesn't have."""
    settings = Settings(preset=preset, gloss="off")
    if not setting.evk4:
        settings = replace(settings, thresholds="known", refractory="known", lag="off")
    settings = settings if priors else replace(settings, priors=())
    return evsdr.fit(rendered.scene(setting), recording, settings).maps


def limit(rendered: Rendered, setting: Setting, recording: Recording) -> Limit:
    """Give the limit of a recording."""
    light = rendered.object.illumination
    light = replace(light, constant_light=type(light.constant_light)(setting.constant_light))
    seen = replace(rendered.object, illumination=light)
    scene = rendered.scene(setting)
    return limit_of(scene, seen, recording.schedule, setting.rounds, setting.pixel(), TOLD)


def recover_own_light(rendered: Rendered, setting: Setting, recording: Recording, seed: int = 0) -> Maps:
    """Record the light that the model has, of one normal per pixel, as a recording did; solve each pixel alone."""
    truth, light = rendered.truth, rendered.object.illumination
    given = truth.normal, truth.reflectance, truth.mask, light, recording.schedule, setting.rounds
    plan = Plan(*given, setting.pixel())
    number = np.flatnonzero(truth.mask)
    image = np.zeros((light.n_led, *truth.mask.shape))
    image[:, truth.mask] = pixels_of(plan, number).signals(theta_of(plan, number), plan.rig)[:, 0].T
    recording = record_light(image, setting.constant_light, plan.pixel, plan.schedule, plan.n_round, seed)
    problem = make_problem(recording, pair_events(recording, truth.mask), light, truth.mask)
    light, effort = problem.illumination, recipes.Effort(priors=None)
    data = loop.data_of(
        LambertianRing(light), problem.pairs, light.constant_light, problem.grid, effort.width(False)
    )
    frontal = np.tile([0.0, 0.0, 1.0], (problem.n_pixel, 1))
    start = first_theta(frontal, light.n_band, False, type(light.constant_light))
    theta = loop.solve(data, recipes.whole(effort), loop.start_of(data, start, effort.n_early)).theta
    normal, reflectance = np.zeros(truth.normal.shape), np.zeros(truth.reflectance.shape)
    normal[truth.mask], reflectance[truth.mask] = to_normal(theta), np.exp(theta[:, 2:])
    return Maps(
        normal, reflectance, truth.mask, np.zeros(truth.mask.shape), np.zeros(reflectance.shape), np.empty(0)
    )


def run_own_light(rendered: Rendered, setting: Setting, n: int) -> list[dict]:
    """Give the figures of `compare` for n recordings of the light that the model has."""
    recording = record(rendered, setting)
    least = limit(rendered, setting, recording)
    maps = (recover_own_light(rendered, setting, recording, seed) for seed in range(n))
    return [compare(found, rendered.truth, least) | {"scene": rendered.name} for found in maps]


def run(
    rendered: Rendered, setting: Setting, presets: tuple[str, ...] = ("balanced",), own: bool = False
) -> list[dict]:
    """Record a setting once and fit it with each preset, pixels alone and with priors.

    Returns
    -------
    list of dict
        The figures of `compare` and `shares_within`, with `scene`, `sensor`, `preset`, `priors` and `events` per pixel
        of the object; empty where too few events fire to fit anything. With `own` the first is that of
        `recover_own_light`, which says no sigma.
    """
    recording = record(rendered, setting)
    try:
        least = limit(rendered, setting, recording)
    except InputError:  # no pixel fires two events
        return []
    rate = len(recording.events) / np.count_nonzero(rendered.truth.mask)
    which = {"scene": rendered.name, "sensor": "EVK4" if setting.evk4 else "ideal", "events": rate}
    found = {(OWN, False): recover_own_light(rendered, setting, recording)} if own else {}
    for preset in presets:
        for priors in (False, True):
            found[preset, priors] = recover(rendered, setting, recording, preset, priors)
    rows = []
    for (preset, priors), maps in found.items():
        shares = {} if preset == OWN else shares_within(maps, rendered.truth)
        row = which | {"preset": preset, "priors": priors}
        rows.append(row | compare(maps, rendered.truth, least) | shares)
    return rows
