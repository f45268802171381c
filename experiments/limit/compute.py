"""Recordings of one scene under many settings: what is recovered, and what could be at best.

Import once a scene is loaded, or after `evsdr.jit.start()`.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import evsdr
from evsdr import EventPixel, InputError, Maps, Recording, Settings, Truth, angular_error_deg
from evsdr.limits.bound import Bound
from evsdr.limits.judge import Rendering, find_bound, render_object

SCENES = Path(__file__).resolve().parents[2] / "scenes"
SPP = 16  # rays per pixel of the images, and for visibility
KNOWN_DEG = 30.0  # bound of a normal up to which a pixel is compared with it
LEAST_NOISE = 0.01  # event noise of the bound where there is none: without noise it would be 0


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
    """

    constant_light: float = 0.05
    threshold_on: float = 0.2525
    threshold_off: float = 0.3795
    noise: float = 0.1
    rounds: int = 6

    def pixel(self) -> EventPixel:
        """Give the event pixel: ideal but for event noise and refractory period."""
        return EventPixel(self.threshold_on, self.threshold_off, event_noise=self.noise).idealised()


BASE = Setting()
SWEEPS = {
    "constant light": [
        (c, replace(BASE, constant_light=c)) for c in (0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0)
    ],
    "threshold": [
        (c, replace(BASE, threshold_on=c, threshold_off=c)) for c in (0.05, 0.1, 0.17, 0.25, 0.35, 0.5)
    ],
    "noise": [(s, replace(BASE, noise=s)) for s in (0.0, 0.02, 0.05, 0.1, 0.2, 0.3)],
    "rounds": [(n, replace(BASE, rounds=n)) for n in (1, 2, 6, 12, 24)],
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
    """Simulate a recording, as `evsdr.simulate --ideal` does; it tells the thresholds."""
    scene = rendered.scene(setting)
    return evsdr.simulate(scene, setting.pixel(), rounds=setting.rounds, seed=seed, spp=SPP)[0]


def recover(rendered: Rendered, setting: Setting, recording: Recording, preset: str, priors: bool) -> Maps:
    """Fit a recording as `evsdr.fit --thresholds known` does, without a look for what the pixels don't have."""
    settings = Settings(preset=preset, thresholds="known", refractory="known", lag="off", gloss="off")
    settings = settings if priors else replace(settings, priors=())
    return evsdr.fit(rendered.scene(setting), recording, settings).maps


def bound_of(rendered: Rendered, setting: Setting, recording: Recording) -> Bound:
    """Give the bound of a recording; without event noise, that of `LEAST_NOISE`."""
    pixel, light = setting.pixel(), rendered.object.illumination
    pixel = replace(pixel, event_noise=max(pixel.event_noise, LEAST_NOISE))
    light = replace(light, constant_light=type(light.constant_light)(setting.constant_light))
    scene = rendered.scene(setting)
    return find_bound(
        scene, replace(rendered.object, illumination=light), recording.schedule, setting.rounds, pixel
    )


def compare(maps: Maps, truth: Truth, bound: Bound) -> dict:
    """Compare maps with truth and bound.

    Returns
    -------
    dict
        `angle`, `reflectance`: mean error, as angle [deg] and as root mean square over bands, over the pixels whose
        normal is bounded by KNOWN_DEG, or whose reflectance is bounded in all bands; `..._known`: their share;
        `..._bound`: mean of the bound over them; `..._ratio`: error / bound; None where no pixel is known. And the
        metrics of `score` over all of the truth's pixels.
    """
    figures = evsdr.score(maps, truth)
    for name, found, least, known in (
        (
            "angle",
            angular_error_deg(maps.normal, truth.normal),
            bound.normal_sigma_deg,
            bound.normal_sigma_deg < KNOWN_DEG,
        ),
        (
            "reflectance",
            np.sqrt(np.mean((maps.reflectance - truth.reflectance) ** 2, axis=-1)),
            np.sqrt(np.mean(bound.reflectance_sigma**2, axis=-1)),
            (bound.reflectance_sigma < 1).all(axis=-1),
        ),
    ):
        known = known & truth.mask
        mean, limit = (float(v[known].mean()) if known.any() else None for v in (found, least))
        figures |= {
            f"{name}_known": np.count_nonzero(known) / np.count_nonzero(truth.mask),
            name: mean,
            f"{name}_bound": limit,
            f"{name}_ratio": mean / limit if known.any() else None,
        }
    return figures


def run(rendered: Rendered, setting: Setting, presets: tuple[str, ...] = ("balanced",)) -> list[dict]:
    """Record a setting once and fit it with each preset, pixels alone and with priors.

    Returns
    -------
    list of dict
        The figures of `compare`, with `scene`, `preset`, `priors` and `events` per pixel of the object; empty
        where too few events fire to fit anything.
    """
    recording = record(rendered, setting)
    try:
        bound = bound_of(rendered, setting, recording)
    except InputError:  # no pixel fires two events
        return []
    rate = len(recording.events) / np.count_nonzero(rendered.truth.mask)
    rows = []
    for preset in presets:
        for priors in (False, True):
            maps = recover(rendered, setting, recording, preset, priors)
            which = {"scene": rendered.name, "preset": preset, "priors": priors, "events": rate}
            rows.append(which | compare(maps, rendered.truth, bound))
    return rows


def shares_within(maps: Maps, truth: Truth) -> dict:
    """Tell how often the truth lies within one and two sigma, over known pixels of the truth [share].

    Returns
    -------
    dict
        `angle_1`, `angle_2` for normals, `reflectance_1`, `reflectance_2` for reflectance, each band by itself,
        and `known`, the share of pixels that the maps know.
    """
    known = maps.mask & truth.mask
    angle = angular_error_deg(maps.normal, truth.normal)[known] / maps.normal_sigma_deg[known]
    reflectance = (np.abs(maps.reflectance - truth.reflectance) / maps.reflectance_sigma)[known]
    shares = {"known": np.count_nonzero(known) / np.count_nonzero(truth.mask)}
    for name, value in (("angle", angle), ("reflectance", reflectance)):
        shares |= {f"{name}_{k}": float(np.mean(value < k)) if known.any() else None for k in (1, 2)}
    return shares


def calibrate(rendered: Rendered) -> list[dict]:
    """Fit the base case and give the figures of `shares_within`, pixels alone and with priors."""
    recording = record(rendered, BASE)
    return [
        {"scene": rendered.name, "size": rendered.size, "priors": priors}
        | shares_within(recover(rendered, BASE, recording, "balanced", priors), rendered.truth)
        for priors in (False, True)
    ]
