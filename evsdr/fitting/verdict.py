"""Whether a fit can be trusted: what its user should look into, and one word on all of it."""

import warnings
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from evsdr.effects.payment import thresholds_apart
from evsdr.effects.shared import WARNED, last_found
from evsdr.effects.world import Fitted, World
from evsdr.errors import InputWarning
from evsdr.fitting.following import UNSETTLED
from evsdr.fitting.report import threshold_summary
from evsdr.solve.noise import MISFIT

TRUSTWORTHY, DOUBTFUL, CONTRADICTED = "trustworthy", "doubtful", "contradicted"
WRONG_THRESHOLD = 0.1  # of its logarithm, from which a told threshold is worth a warning
CONTRARY = 50.0  # noise of a pixel, relative to most, whose events count for nothing
CONTRARY_SHARE, CONTRARY_COUNT = 0.01, 5  # of the pixels, from which they are worth a warning
MENDED_MISFIT = 0.25  # `MISFIT` after LEDs were put right: what remains was not theirs
UNSCALED = 0.02  # of the known pixels, from which scales that are not known are worth a warning
FAINT = 0.005  # of an LED's light, below which a constant light is too weak; guessed: experiments/extremes has 0.002 too weak, 0.02 not
# Of a threshold, residuals that come again in every round. Measured: 0 to 0.035 where sigmas hold, 0.055 to 0.11 on sculptures in
# their own light, and 0.067 to 0.074 on a sphere under a lamp of 100 Hz, where they do not
RECURRING = 0.05
# Of the known pixels, from which LEDs are hidden as nothing but their events tells: measured, 0.57 on a lion whose sigmas do not
# hold (94 % within three), 0.29 to 0.35 on a relief, a goathead, Nefertiti and a skull, whose do
SHADOWED = 0.5
FEW_KNOWN = 0.5  # of the pixels that fire; guessed
# Sigmas by which the brightest band of a share of the pixels must exceed 1. Measured: a tenth exceeds 2.5 to 3.3 under a constant light that is
# told 10 times (`experiments.setup_errors`), but at most 0.75 where it is told right, also in 43 draws (`experiments.draws`)
BRIGHT_SIGMAS, BRIGHT_SHARE = 2.0, 0.1


@dataclass(frozen=True)
class Verdict:
    """What to think of a fit.

    Attributes
    ----------
    contradictions : tuple of str
        Sentences on what in the files can't be.
    doubts : tuple of str
        Sentences on what may be wrong.
    """

    contradictions: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()

    def __str__(self) -> str:
        if self.contradictions:
            return f"{CONTRADICTED}: {' '.join(self.contradictions)}"
        return f"{DOUBTFUL}: {' '.join(self.doubts)}" if self.doubts else TRUSTWORTHY


def judge(
    world: World, fitted: Fitted, stopped: bool = False, recurring: float = 0.0, moved: float = 0.0
) -> Verdict:
    """Judge a fit, stopped early or not, and warn its user of what they should look into.

    `recurring` is how large residuals are, of a threshold, that come again in every round, see `misfit.Misfit`; `moved` is how far
    they still move, see `following.moves`.
    """
    ring = world.ring
    if ring.constant_light == 0:
        warn(
            f"{ring.path}: constant_light is 0, so the scale of reflectance is unknown and the "
            "largest band of each pixel is set to 1; measure the constant light and write it there."
        )
    contradictions = tuple(contradictions_of(world, fitted))
    # Under a contradiction what else is odd comes of that
    doubts = tuple(ignorance(world, fitted))
    if not contradictions:
        doubts += (*unexplained(world, recurring), *shadowed(world, fitted), *doubts_of(world, fitted))
        doubts += tuple(unsettled_light(world, moved))
    if stopped:
        early = "this fit was stopped early, so that errors may be larger than sigmas say; let it end."
        doubts = (f"{world.recording.source}: {early}", *doubts)
    for sentence in (*doubts, *contradictions):
        warn(sentence)
    return Verdict(contradictions, doubts)


def warn(sentence: str) -> None:
    """Warn the user of their input."""
    warnings.warn(InputWarning(sentence))


def contradictions_of(world: World, fitted: Fitted) -> Iterator[str]:
    """Say what in the files can't be: a set-up that another one explains, or that nothing explains."""
    noise, source, ring = fitted.solution.noise, world.recording.source, world.ring
    told, wiring = (world.decisions.get(name) for name in ("set-up", "wiring"))
    if told and told.answer and not told.modelled:
        yield f"{source}: {told.answer}; {told.found['remedy']}, or use --repair."
    elif noise > (MENDED_MISFIT if wiring and wiring.modelled else MISFIT):
        yield (
            f"{source}: the events contradict {ring.path}, their thresholds scatter by "
            f"{noise:.0%}; check order, slot_us, triggers, thresholds and constant_light."
        )


def ignorance(world: World, fitted: Fitted) -> Iterator[str]:
    """Say that few pixels are known, or few scales."""
    source, maps = world.recording.source, fitted.maps
    known, scaled = np.count_nonzero(maps.mask), np.count_nonzero(maps.mask_reflectance)
    fired = np.count_nonzero(fitted.problem.fired)
    if not known:
        yield f"{source}: no pixel is known; record more rounds, or with less constant light."
    elif known < FEW_KNOWN * fired:
        yield f"{source}: only {known / fired:.0%} of the pixels that fire are known; record more rounds."
    if world.ring.constant_light > 0 and scaled < (1 - UNSCALED) * known:
        yield (
            f"{source}: {1 - scaled / known:.0%} of the known pixels can't tell their scale, see mask_reflectance: "
            "put a dark slot (-1 in schedule/order) before every third LED."
        )


def unexplained(world: World, recurring: float) -> Iterator[str]:
    """Say that the events show light which the model lacks."""
    if recurring > RECURRING:
        yield (
            f"{world.recording.source}: residuals of {recurring:.2g} of a threshold come again in every round, so that errors may "
            "be larger than sigmas say: other light, as of a lamp, gloss, shadows, or light by way of other surfaces may be the "
            "cause; `misfit` in the summary tells where."
        )


def shadowed(world: World, fitted: Fitted) -> Iterator[str]:
    """Say that so much lies in shadows that only events tell of that their edges are not sure."""
    visible = fitted.problem.visible
    if world.shadows != "latent" or world.ring.shape_is_known or visible is None:
        return
    known = fitted.maps.mask.ravel()[fitted.problem.pixel]
    share = np.mean((visible < 0.5).any(axis=0)[known]) if known.any() else 0.0
    if share > SHADOWED:
        yield (
            f"{world.recording.source}: {share:.0%} of the known pixels lie in the shadow of some LEDs, as only their events tell, "
            "so that errors may be larger than sigmas say: tell the shape in the scene file, or light it from steeper LEDs."
        )


def doubts_of(world: World, fitted: Fitted) -> Iterator[str]:
    """Say what may be wrong: what was mended, pixels that are not explained, thresholds that are not as told."""
    source = world.recording.source
    for decision in world.decisions.values():
        if decision.modelled and decision.warning:
            yield f"{source}: {decision.warning}"
        if decision.doubt:
            yield f"{source}: {decision.doubt}"
    yield from torn_thresholds(world, fitted)
    yield from faint_light(world, fitted)
    yield from too_bright(world, fitted)
    yield from contrary_pixels(world, fitted)
    for name, values in threshold_summary(world.recording, fitted).items():
        if abs(np.log(values["found"] / values["told"])) > WRONG_THRESHOLD:
            yield (
                f"{source}: {name} is told as {values['told']:.3g} but the events say "
                f"{values['found']:.3g}; the latter was used: "
                "check the camera's biases, or the surface is not matt."
            )


def torn_thresholds(world: World, fitted: Fitted) -> Iterator[str]:
    """Say that thresholds by which maps explain their events are others than those that were inferred with all else that pixels share."""
    apart = thresholds_apart(fitted, world)
    if not apart.any():
        return
    sigma = last_found(world.decisions).inferred.sigma.log_threshold
    if (np.abs(apart) > np.maximum(WRONG_THRESHOLD, WARNED * sigma)).any():
        on, off = np.expm1(np.abs(apart))
        yield (
            f"{world.recording.source}: the mean contrast thresholds are {on:.0%} (on) and {off:.0%} (off) apart as all pixels together "
            "and as their maps have them, so that errors may be larger than sigmas say; measure them by python -m evsdr.calibrate "
            "thresholds, and tell them."
        )


def unsettled_light(world: World, moved: float) -> Iterator[str]:
    """Say that what photoreceptors show of the maps is not yet what these were fitted to."""
    if moved > UNSETTLED:
        yield (
            f"{world.recording.source}: photoreceptors are so slow for this light that a better fit would move residuals by "
            f"{moved:.1g} of their noise, so that errors may be larger than sigmas say; make slots longer, or the light stronger."
        )


def faint_light(world: World, fitted: Fitted) -> Iterator[str]:
    """Say that the constant light is so weak that events in the dark come as fast as the sensor tells times."""
    veil, known = world.ring.constant_light, fitted.maps.mask_reflectance
    if veil == 0 or not known.any():
        return
    light = np.median([np.mean(np.array(e)) for e in fitted.problem.illumination.irradiance])
    share = veil / (float(light * np.median(fitted.maps.reflectance[known])) + veil)
    if share < FAINT:
        yield (
            f"{world.ring.path}: constant_light is {share:.2g} of the light of an LED, so weak that errors may be larger than "
            "sigmas say; make it about half of that light."
        )


def too_bright(world: World, fitted: Fitted) -> Iterator[str]:
    """Say that surfaces reflect more light than they get: it is the constant light that makes reflectances absolute."""
    maps, veil = fitted.maps, world.ring.constant_light
    if veil == 0 or not maps.mask_reflectance.any():
        return
    least = (maps.reflectance - BRIGHT_SIGMAS * maps.reflectance_sigma)[maps.mask_reflectance].max(axis=-1)
    if np.quantile(least, 1 - BRIGHT_SHARE) > 1:
        most = np.quantile(maps.reflectance[maps.mask_reflectance].max(axis=-1), 1 - BRIGHT_SHARE)
        yield (
            f"{world.ring.path}: a tenth of the pixels reflect {most:.1f} times the light that they get, and more, so constant_light is "
            "probably told too large, and all reflectances with it; measure it and write it there."
        )


def contrary_pixels(world: World, fitted: Fitted) -> Iterator[str]:
    """Say how many pixels fire events that the light does not explain."""
    pixel = fitted.problem.pixel
    contrary = fitted.solution.noise_factor > CONTRARY
    if world.hot is not None:
        contrary = contrary | world.hot.ravel()[pixel]
    if np.count_nonzero(contrary) < max(CONTRARY_COUNT, CONTRARY_SHARE * len(contrary)):
        return
    count = np.diff(fitted.problem.told.offset.astype(np.int64))[pixel]
    often = np.median(count[contrary]) > 2 * np.median(count[~contrary]) if not contrary.all() else False
    cause = (
        "they fire more often than the others, so they are probably hot: mask them in the camera"
        if often
        else "gloss, a shadow that is not modelled, or other light may be the cause"
    )
    yield (
        f"{world.recording.source}: {contrary.mean():.0%} of the pixels fire events that the light of the ring does not explain; "
        f"{cause}. Their values come from their neighbours."
    )
