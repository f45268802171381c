"""What of the light is modelled, and why: decisions from cheap tests.

Every decision compares the normals' mean expected error, if an effect is left out, with a limit; see `sensitivity`.
"""

from dataclasses import dataclass, field, replace

import drjit as dr
import numpy as np

from evsdr.effects.sensitivity import expected_error_deg, signals, some_of
from evsdr.light.ground_truth import object_depth, object_normals
from evsdr.light.scene import RingScene
from evsdr.light.tracing import trace_illumination
from evsdr.model.illumination import Illumination
from evsdr.records import Maps
from evsdr.solve.levenberg import REFLECTANCE_CENTRE

LIMIT_DEG = 0.05  # mean error of the normals, from which an effect is modelled
RAYS_LIMIT_DEG = 0.02  # the same, of what is left to chance in rays
TRIAL_RAYS = 4  # per pixel: of trials, and on an estimated shape
FACING = 0.05  # cosine from which a surface that faces an LED should be lit


@dataclass(frozen=True)
class Asked:
    """What the user wants modelled.

    Attributes
    ----------
    shadows : str
        `auto`, `off`, `scene`, `estimate` or `downweight`.
    leds : str
        `auto`, `near` or `far`.
    light_paths : str
        `auto`, `direct` or `indirect`.
    rays : int
        Most rays per pixel.
    seed : int
        Of the rays; another than a simulation's, or its sampling noise would cancel.
    """

    shadows: str = "auto"
    leds: str = "auto"
    light_paths: str = "auto"
    rays: int = 16
    seed: int = 1


@dataclass(frozen=True)
class Light:
    """What the LEDs send to the pixels, as far as it is modelled.

    Attributes
    ----------
    illumination : Illumination
        Arrays of width 1 or height * width.
    coverage : (height, width) float32
        Share of each pixel that the object covers.
    shadows, near : bool
        Whether cast shadows, and direction and fall-off per pixel, are in it.
    notes : dict of str
        What was decided and why.
    expected : dict of float
        Expected error of the normals without each effect [deg], where it was asked for.
    """

    illumination: Illumination
    coverage: np.ndarray
    shadows: bool
    near: bool
    notes: dict
    expected: dict = field(default_factory=dict)


def first_light(ring: RingScene, asked: Asked) -> Light:
    """Trace the light of the first fit, on the scene's geometry or its placeholder."""
    plain, coverage = trace_illumination(ring, TRIAL_RAYS, False, asked.seed)
    look = _guess(ring, coverage)
    near, leds, error_near = choose_leds(ring, plain, look, asked.leds)
    shape_counts = asked.shadows == "scene" or (asked.shadows == "auto" and ring.shape_is_known)
    expected = {"near LEDs": error_near} if error_near is not None else {}
    shadows, note = shape_counts, SHADOW_NOTES.get(asked.shadows, "")
    light, rays = plain, f"{TRIAL_RAYS}: for the object's outline; no visibility is sampled"
    if shape_counts:
        if asked.shadows == "auto":
            # at pixel centres, where the normals are: others may lie behind the horizon
            centres, _ = trace_illumination(ring, 1, True)
            error = mean_error(look, plain, centres)
            shadows = error > LIMIT_DEG
            expected["cast shadows"] = error
            note = shadow_note(shadows, blocked_share(look, plain, centres), error, "the scene's geometry")
    if shadows:
        light, _ = trace_illumination(ring, TRIAL_RAYS, True, asked.seed)
        light, rays = choose_rays(ring, look, light, asked)
    else:
        light = plain
    if ring.is_near and not near:
        light = as_far(light, plain, look.pixel)
    notes = {"cast shadows": note, "LEDs": leds, "rays per pixel": rays}
    return Light(light, coverage, shadows, near, notes, expected)


SHADOW_NOTES = {
    "off": "not modelled: asked for by --shadows off",
    "downweight": "down-weighted: asked for by --shadows downweight",
    "scene": "traced on the scene's geometry: asked for by --shadows scene",
    "estimate": "traced on the estimated depth: asked for by --shadows estimate",
}


@dataclass(frozen=True)
class Look:
    """Some pixels with their normals (n, 3) and reflectances (n, n_band): what decisions are made on."""

    pixel: np.ndarray
    normal: np.ndarray
    reflectance: np.ndarray


def _guess(ring: RingScene, coverage: np.ndarray) -> Look:
    """Look at the scene's geometry, with reflectances that are not yet known."""
    pixel = np.flatnonzero((coverage >= 0.5) & (object_depth(ring) > 0))
    if len(pixel):
        pixel = pixel[some_of(len(pixel))]
    normal = object_normals(ring).reshape(-1, 3)[pixel]
    return Look(pixel, normal, np.full((len(pixel), ring.leds.n_band), REFLECTANCE_CENTRE))


def look_at(maps: Maps) -> Look:
    """Look at what was fitted."""
    pixel = np.flatnonzero(maps.mask)
    if len(pixel):
        pixel = pixel[some_of(len(pixel))]
    n_band = maps.reflectance.shape[-1]
    return Look(
        pixel,
        maps.normal.reshape(-1, 3)[pixel].astype(float),
        maps.reflectance.reshape(-1, n_band)[pixel].astype(float),
    )


def _arrays(light: Illumination, pixel: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Give directions (n_led, n, 3) and irradiances (n_led, n) at some pixels."""

    def at(values):
        values = np.asarray(values, float)
        return np.broadcast_to(values, (len(pixel),)) if values.size == 1 else values[pixel]

    direction = [np.stack([at(d[k].numpy()) for k in range(3)], axis=-1) for d in light.direction]
    return np.array(direction), np.array([at(e.numpy()) for e in light.irradiance])


def signals_of(look: Look, light: Illumination) -> np.ndarray:
    """Give the signals (n, n_led) of a light at the pixels looked at, indirect light included."""
    out = signals(look.normal, look.reflectance, *_arrays(light, look.pixel), light.band)
    if light.indirect is not None:
        more = np.array([e.numpy()[look.pixel] for e in light.indirect])
        out = out + look.reflectance[:, light.band] * more.T
    return out


def mean_error(look: Look, model: Illumination, real: Illumination) -> float:
    """Give the mean expected error of the normals [deg] if the light is `real` but `model` is fitted."""
    if len(look.pixel) == 0:
        return 0.0
    change = signals_of(look, real) - signals_of(look, model)
    level = np.max(signals_of(look, real))
    constant = max(float(model.constant_light[0]), 1e-3 * level, 1e-9)
    given = _arrays(model, look.pixel)
    error = expected_error_deg(look.normal, look.reflectance, *given, model.band, constant, change)
    return float(error.mean())


def blocked_share(look: Look, plain: Illumination, shadowed: Illumination) -> float:
    """Give the share of (pixel, LED) that face each other yet are blocked."""
    direction, irradiance = _arrays(plain, look.pixel)
    faces = (np.einsum("jnk,nk->jn", direction, look.normal) > FACING) & (irradiance > 0)
    visible = _arrays(shadowed, look.pixel)[1] / np.where(irradiance > 0, irradiance, 1)
    return float(np.sum((1 - np.minimum(visible, 1))[faces]) / max(np.count_nonzero(faces), 1))


def shadow_note(modelled: bool, share: float, error: float, geometry: str) -> str:
    """Say what was decided on cast shadows."""
    found = f"{share:.2%} of the (pixel, LED) pairs that face each other are blocked on {geometry}"
    if not modelled and share == 0:
        return f"not modelled: no (pixel, LED) pair that faces each other is blocked on {geometry}"
    return f"{f'traced on {geometry}' if modelled else 'not modelled'}: {found}; {against(error, modelled)}"


def against(error: float, modelled: bool, limit: float = LIMIT_DEG) -> str:
    """Compare an expected error with its limit."""
    turn = f"left out, that turns normals by {error:.2g} degrees"
    return f"{turn}, {'more' if modelled else 'less'} than {limit:g}"


def choose_leds(
    ring: RingScene, light: Illumination, look: Look, asked: str
) -> tuple[bool, str, float | None]:
    """Decide whether directions and fall-off are per pixel, and say why; gives the expected error, too."""
    count = f"{ring.leds.n_led} in {ring.leds.n_band} bands"
    near_text, far_text = "near: direction and fall-off per pixel", "far: one direction for all pixels"
    if not ring.is_near:
        return False, f"{count}, {far_text}", None
    if asked != "auto" or len(look.pixel) == 0:
        near = asked != "far"
        return near, f"{count}, {near_text if near else far_text}: asked for by --leds {asked}", None
    error = mean_error(look, as_far(light, light, look.pixel), light)
    near = error > LIMIT_DEG
    return near, f"{count}, {near_text if near else far_text}; parallax {against(error, near)}", error


def as_far(light: Illumination, plain: Illumination, pixel: np.ndarray) -> Illumination:
    """Give every LED one direction and one irradiance, the means over some pixels; visibility stays."""
    direction, irradiance = [], []
    for d, e, whole in zip(light.direction, light.irradiance, plain.irradiance):
        arriving = np.stack([c.numpy() for c in d])
        if arriving.shape[1] == 1:
            direction.append(d)
            irradiance.append(e)
            continue
        mean = arriving[:, pixel].mean(axis=1)
        level = float(whole.numpy()[pixel].mean())
        direction.append(type(d)(*(mean / np.linalg.norm(mean)).tolist()))
        same = e is whole
        share = dr.select(whole > 0, e / dr.maximum(whole, 1e-20), 0.0)
        irradiance.append(type(e)(level) if same else level * share)
    return replace(light, direction=direction, irradiance=irradiance)


def choose_rays(ring: RingScene, look: Look, trial: Illumination, asked: Asked) -> tuple[Illumination, str]:
    """Trace visibility with as many rays as its chance needs.

    Two trials tell the error; stratified rays make it fall with their number to the power 3/4.
    """
    again, _ = trace_illumination(ring, TRIAL_RAYS, True, asked.seed + 1)
    error = mean_error(look, trial, again) / 2**0.5
    needed = TRIAL_RAYS * (error / RAYS_LIMIT_DEG) ** (4 / 3)
    rays = next((n for n in (TRIAL_RAYS, 16, 64) if n >= needed), 64)
    why = f"{TRIAL_RAYS} leave {error:.2g} degrees to chance, {RAYS_LIMIT_DEG:g} are wanted"
    if rays > asked.rays:
        rays, why = asked.rays, f"{why}; the preset allows no more"
    light = trial if rays == TRIAL_RAYS else trace_illumination(ring, rays, True, asked.seed)[0]
    return light, f"{rays}: {why}"


def path_note(asked: str, modelled: bool = False, error: float | None = None) -> str:
    """Say what was decided on indirect light."""
    if asked != "auto":
        what = "direct light only" if asked == "direct" else "direct and indirect light"
        return f"{what}: asked for by --light-paths {asked}"
    if error is None:
        return "direct light only: max_depth of the scene is 1"
    what = "direct and indirect light" if modelled else "direct light only"
    return f"{what}: indirect light, {against(error, modelled)}"
