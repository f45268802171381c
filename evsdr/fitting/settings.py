"""What a user asks of a fit."""

from dataclasses import dataclass
from typing import Literal, get_args, get_origin, get_type_hints

from evsdr.errors import InputError, check_range
from evsdr.solve.shared.rig import GROUPS
from evsdr.solve.tuning import Tuning

PRIORS = ("normal", "integrable", "reflectance", "spectra")
SHARED = tuple(GROUPS)


@dataclass(frozen=True)
class Settings:
    """What is asked of each effect, and how hard to try."""

    preset: Literal["fast", "balanced", "accurate"] = "balanced"
    """Speed against accuracy."""
    solver: Literal["lm", "adam"] = "lm"
    """Per-pixel Levenberg-Marquardt, or the decoder of the EventSpecPS paper."""
    shadows: Literal["auto", "off", "scene", "estimate", "latent", "downweight"] = "auto"
    """Cast shadows: left out, traced on the scene's geometry, traced on the depth that the fitted normals give,
    found in the events of each pixel, down-weighted as outliers, or decided from what they would change."""
    leds: Literal["auto", "near", "far"] = "auto"
    """LEDs at finite distance: direction and fall-off per pixel, one for all pixels, or decided from the parallax."""
    light_paths: Literal["auto", "direct", "indirect"] = "auto"
    """Light by way of other surfaces; auto models it where max_depth of the scene is above 1 and it counts."""
    gloss: Literal["auto", "off", "lobe", "blinn-phong"] = "auto"
    """Highlights: left out, a rough dielectric coating or a Blinn-Phong lobe fitted with the maps, or decided from the
    residuals: the coating, or nothing."""
    thresholds: Literal["auto", "known", "estimate"] = "auto"
    """Contrast thresholds: as the recording tells, or estimated per pixel; auto estimates them where it tells
    one value for all pixels."""
    refractory: Literal["auto", "known", "estimate"] = "auto"
    """Refractory period of the sensor: as the recording tells, or estimated; auto estimates it where the recording
    does not tell it."""
    lag: Literal["auto", "off"] = "auto"
    """Lag of the photoreceptors in dim light: estimated if the events show one, or left out."""
    shared: tuple[str, ...] = SHARED
    """What all pixels share and is unknown, with what is told as a prior: powers of LEDs against the others of their
    band, lag and noise of photoreceptors, shift of all times, refractory period, a leak, thresholds, directions of
    LEDs."""
    leds_told_to: float = 0.0
    """How well the scene tells the directions of far LEDs: one standard deviation [deg]; 0 takes them as told."""
    priors: tuple[str, ...] = PRIORS
    """What pixels tell of each other: smooth normals, slopes of one surface, smooth reflectance, spectra of few
    kinds. Edges stay, and the data decide how strong each is."""
    init: Literal["frontal", "geometry"] = "frontal"
    """Start value of the normals."""
    repair: bool = False
    """If the set-up is told wrong and the events tell how, fit with that mended."""
    seed: int = 0
    """Seed of everything random."""
    limit_deg: float = 0.05
    """Mean error of the normals [deg] from which auto models an effect."""
    tolerance: float | None = None
    """Gain in log likelihood of a pixel that is worth a step of the solver; by default that of the preset."""
    time_budget: float | None = None
    """Seconds that the fit may take: the best preset that this machine is expected to manage replaces the one asked for,
    and what is found by then counts."""
    tuning: Tuning = Tuning()
    """Numbers of the solver."""


def check_settings(settings: Settings) -> None:
    """Refuse what no setting can be.

    Raises
    ------
    InputError
        A choice, a prior or the seed is none.
    """
    for name, kind in get_type_hints(Settings).items():
        chosen = getattr(settings, name)
        if get_origin(kind) is Literal and chosen not in get_args(kind):
            raise InputError(f"{name} is {chosen!r}; choose one of {', '.join(get_args(kind))}.")
    check_names(settings.priors, PRIORS, "priors")
    check_names(settings.shared, SHARED, "shared")
    if not 0 <= settings.leds_told_to < 45:
        raise InputError(f"leds_told_to is {settings.leds_told_to:g}; give degrees, 0 to 45.")
    check_range("seed", settings.seed, 0)
    if not settings.limit_deg > 0:
        raise InputError(f"limit_deg is {settings.limit_deg:g}; give degrees above 0.")
    if settings.tolerance is not None and not settings.tolerance > 0:
        raise InputError(f"tolerance is {settings.tolerance:g}; give a number above 0, as 0.1.")
    if settings.time_budget is not None and not settings.time_budget > 0:
        raise InputError(f"time_budget is {settings.time_budget:g}; give seconds above 0.")


def check_names(names: tuple[str, ...], known: tuple[str, ...], what: str) -> None:
    """Refuse names that there are not; `what` names their source."""
    for name in names:
        if name not in known:
            raise InputError(f"{what}: there is no {name!r}; name some of {', '.join(known)}, or none.")
