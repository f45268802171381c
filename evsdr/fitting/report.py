"""What a fit says of itself: what it modelled, left out, and why."""

from dataclasses import asdict, fields

import numpy as np

from evsdr import __version__
from evsdr.effects.world import Fitted, World
from evsdr.fitting.maps import lit_bands
from evsdr.fitting.settings import Settings
from evsdr.light.scene import RingScene
from evsdr.records import Recording, Sensor
from evsdr.solve.solution import Solution

SENSOR = [field.name for field in fields(Sensor)]


def summarise(world: World, settings: Settings, fitted: Fitted, notes: dict) -> dict:
    """Give the summary of a fit, without its error against a truth.

    Parameters
    ----------
    notes : dict of str
        What else to say of the model than the world's decisions.
    """
    pairs, solution = fitted.problem.told, fitted.solution
    decisions = world.decisions.values()
    found = {name: value for d in decisions for name, value in d.found.items() if name in SENSOR}
    return {
        "evsdr": __version__,
        "scene": str(world.ring.path),
        "events": world.recording.source,
        "solver": settings.solver,
        "preset": settings.preset,
        "model": {d.effect: d.why for d in decisions} | notes | model_notes(world, settings, solution),
        "effects": {
            d.effect: {"modelled": d.modelled, "expected_deg": d.expected_deg, "found": d.found}
            for d in decisions
        },
        "numbers": {
            "events": pairs.n_event,
            "pairs": int(pairs.offset[-1]),
            "pairs_dropped": pairs.n_dropped,
            "pixels_solved": fitted.problem.n_pixel,
            "pixels_known": int(np.count_nonzero(fitted.maps.mask)),
            "pixels_of_known_scale": int(np.count_nonzero(fitted.maps.mask_reflectance)),
            "steps": solution.n_step,
        },
        "sensor": threshold_summary(world.recording, fitted) | found,
        "residual": {"relative_threshold_noise": solution.noise},
        "convergence": {
            "result": solution.result,
            "history": [asdict(passed) for passed in solution.history],
        },
    }


def model_notes(world: World, settings: Settings, solution) -> dict:
    """Say what of the model is no effect."""
    return {
        "bands": band_note(world.recording, world.ring),
        **solver_notes(settings, solution),
        "scale": scale_note(world.ring),
    }


def threshold_summary(recording: Recording, fitted: Fitted) -> dict:
    """Say which thresholds were found, how they scatter over the pixels, and how well one is known."""
    solution, known = fitted.solution, fitted.maps.mask.ravel()[fitted.problem.pixel]
    if solution.threshold_gain is None or not known.any():
        return {}
    gain, sigma = solution.threshold_gain[known], solution.threshold_gain_sigma[known]
    out = {}
    for i, name in enumerate(("contrast_threshold_on", "contrast_threshold_off")):
        told = float(np.mean(getattr(recording.sensor, name)))
        spread = 1.4826 * np.median(np.abs(gain[:, i] - np.median(gain[:, i])))
        out[name] = {
            "told": told,
            "found": told * float(np.median(gain[:, i])),
            "spread_over_pixels": told * float(spread),
            "sigma_of_a_pixel": told * float(np.median(gain[:, i] * sigma[:, i])),
        }
    return out


def solver_notes(settings: Settings, solution: Solution) -> dict:
    """Say what of the events the solver used."""
    if settings.solver == "adam":
        return {
            "silence": "not used: the solver adam looks at events only",
            "event times": "not used",
            "neighbours": "blurred, as published",
        }
    return {
        "silence": "used: between events log I stays within the thresholds",
        "event times": "their density counts, with its slope term",
        "neighbours": prior_note(settings.priors, solution),
    }


def prior_note(parts: tuple[str, ...], solution) -> str:
    """Say which priors count, and how strong the data make them."""
    if not parts:
        return "each pixel alone: asked for by --priors none"
    what = {
        "normal": "normals bend by {:.2g} per pixel squared",
        "integrable": "slopes around four pixels add up to {:.2g}",
        "reflectance": "log reflectances bend by {:.2g}",
        "rank": "spectra vary visibly in {} directions",
    }
    found = [what[name].format(value) for name, value in solution.prior_scale.items()]
    return "; ".join(found) or "too few pixels to learn from"


def band_note(recording: Recording, ring: RingScene) -> str:
    """Say which bands are recovered, and with what quadrature."""
    lit = lit_bands(recording.schedule.order, ring.leds.band)
    if lit.all():
        return f"all {len(lit)}, one reflectance each: LEDs of a band share its spectrum, so no quadrature is needed"
    dark = ", ".join(f"{nm:.0f} nm" for nm in ring.leds.band_wavelength_nm[~lit])
    return f"{lit.sum()} of {len(lit)}: order lights no LED of {dark}, whose reflectance has a sigma of 1"


def scale_note(ring: RingScene) -> str:
    """Say whether reflectance is absolute."""
    if ring.constant_light > 0:
        return f"absolute, by the constant light of {ring.constant_light:g}"
    return "unknown: without constant light reflectance is known up to one factor per pixel; its largest band is 1"
