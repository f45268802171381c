"""What a fit believes: all that predicts the events, but for the maps."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import drjit as dr
import numpy as np

from evsdr.effects.gloss_fit import Gloss
from evsdr.effects.lag import Lag, photoreceptors
from evsdr.effects.memo import Memo
from evsdr.effects.sensitivity import Look, look_at, look_at_geometry
from evsdr.effects.shared import Aim, SharedFound
from evsdr.effects.surface import FittedSurface
from evsdr.errors import InputError
from evsdr.events.pairs import Pairs, pair_events
from evsdr.light.camera import view_directions
from evsdr.light.scene import RingScene
from evsdr.light.tracing import trace_illumination, trace_indirect
from evsdr.model.arrays import owned
from evsdr.model.illumination import Illumination
from evsdr.progress import never
from evsdr.records import Maps, Recording
from evsdr.solve.background import Activity, without_chance
from evsdr.solve.pair_data import unlit_by, without
from evsdr.solve.problem import Problem, make_problem
from evsdr.solve.shared.pixels import Nearer
from evsdr.solve.shared.rig import GROUPS, Told
from evsdr.solve.solution import Solution
from evsdr.solve.visibility import Seen, doubtful, find_visibility, left_open, unhide

TRIAL_RAYS = 4  # per pixel: of trials, and for the object's outline
ROUND_RAYS = 1  # per pixel, while light and surface change
SKIP = 0.05  # pixels: hits nearer than that to an estimated surface are the surface itself
MOST_HALVED = 6  # times, of how far a surface may be from where it stands; guessed
SURE = 0.5  # pixels: nearer hits may come of the noise of an estimated surface


@dataclass(frozen=True)
class Fitted:
    """One fit: the problem, its solution, the maps it gives, and what its pixels see of the LEDs if that was asked already."""

    problem: Problem
    solution: Solution
    maps: Maps
    seen: Seen | None = None


@dataclass(frozen=True)
class Terms:
    """By what is decided.

    Attributes
    ----------
    solver : str
        `lm` or `adam`.
    thorough : bool
        Whether effects are looked for that show only in the residuals of a fit.
    limit_deg : float
        Mean error of the normals from which an effect is modelled [deg].
    most_rays : int
        Per pixel.
    seed : int
        Of the rays; another than a simulation's, or its sampling noise would cancel.
    shared : tuple of str
        Of `rig.GROUPS`: what all pixels share and is unknown.
    told : Told
        How well it is told.
    """

    solver: str = "lm"
    thorough: bool = True
    limit_deg: float = 0.05
    most_rays: int = 16
    seed: int = 1
    shared: tuple[str, ...] = tuple(GROUPS)
    told: Told = Told()


@dataclass(frozen=True)
class World:
    """All that predicts the events of a recording, but for the maps.

    Attributes
    ----------
    ring : RingScene
    recording : Recording
        As it is believed to be now.
    mask : (height, width) bool
        Pixels to solve.
    terms : Terms
    surface : FittedSurface
    memo : Memo
        What was traced and paired lately.
    hot : (height, width) bool, optional
        Pixels whose events and silences count for nothing.
    near : bool
        Whether direction and fall-off of LEDs are per pixel.
    shadows : str
        `none`, or the geometry that casts them: `scene`, or `estimate`, the surface of the fit; or `latent`: what the
        events tell of each pixel, with the geometry as its prior.
    moved : bool
        Whether LEDs are near to the surface of the fit, not to that of the scene.
    indirect : bool
        Whether light by way of other surfaces counts.
    rays : int
        Per pixel.
    thresholds : bool
        Whether contrast thresholds are unknown.
    veil : float, optional
        The constant light, where it is not as told.
    lag : Lag, optional
        What photoreceptors do.
    found : SharedFound, optional
        What pixels were found to share from an earlier fit, to start from.
    leak : float
        Rise of what the comparators see since the reference was memorised [log I per us].
    clock_us : float
        Step of the clock, if it is more than a microsecond; each event came within its step.
    aim : Aim, optional
        What LEDs do otherwise than told.
    nearer : float
        By how much the surface is nearer to the camera than the rectangle that stands for it [scene units].
    gloss : Gloss, optional
        Lobes.
    metal : float, optional
        Roughness of the surface, if it is of metal.
    rough : float, optional
        Roughness of its matt part, if that is not Lambert's.
    background : (Activity, Fitted), optional
        How many events come by chance, and the first fit that tells which.
    decisions : dict of Decision
        What was decided so far.
    enough : callable () -> bool
        Says whether to end soon.
    """

    ring: RingScene
    recording: Recording
    mask: np.ndarray
    terms: Terms
    surface: FittedSurface
    memo: Memo
    hot: np.ndarray | None = None
    near: bool = False
    shadows: str = "none"
    moved: bool = False
    indirect: bool = False
    rays: int = TRIAL_RAYS
    thresholds: bool = False
    veil: float | None = None
    lag: Lag | None = None
    leak: float = 0.0
    clock_us: float = 0.0
    found: SharedFound | None = None
    aim: Aim | None = None
    nearer: float = 0.0
    gloss: Gloss | None = None
    metal: float | None = None
    rough: float | None = None
    background: tuple[Activity, Fitted] | None = None
    decisions: dict = field(default_factory=dict)
    enough: Callable[[], bool] = never

    @classmethod
    def before_a_fit(
        cls, ring: RingScene, recording: Recording, mask: np.ndarray, terms: Terms, bounded: bool = True
    ) -> "World":
        """Believe what scene and recording tell; a mask that no one told may hold more than the object."""
        return cls(ring, recording, mask, terms, FittedSurface(ring, bounded), Memo())

    @property
    def on_fit(self) -> bool:
        """Whether direct light is traced on the surface of the fit."""
        return self.shadows == "estimate" or self.moved

    @property
    def light_follows_fit(self) -> bool:
        """Whether light depends on the fit."""
        return self.on_fit or self.indirect or self.shadows == "latent"

    def look(self, fitted: Fitted | None = None) -> Look:
        """Look at some pixels: at what was fitted, or else at the scene's geometry."""
        if fitted is not None:
            return look_at(fitted.maps)
        return self.memo("look", (), lambda: look_at_geometry(self.ring, self.mask))

    def trace(
        self, shadows: bool, rays: int, fitted: Fitted | None = None, skip: float = SKIP, seed: int = 0
    ) -> Illumination:
        """Trace direct light on the scene's geometry, or on the surface of a fit.

        Parameters
        ----------
        shadows : bool
            Whether cast shadows are traced.
        rays : int
            Per pixel.
        fitted : Fitted, optional
            Whose surface stands in the place of the object.
        skip : float
            Hits nearer than that to the surface of a fit are the surface itself [pixels].
        seed : int
            Another one gives other rays.
        """

        def work():
            scene, free = self._placed(fitted, skip, self.nearer)
            given = scene, rays
            light, _ = trace_illumination(*given, shadows, self.terms.seed + seed, free)
            if self.veil is not None:
                light = replace(light, constant_light=dr.opaque(type(light.constant_light), self.veil))
            if self.near or not self.ring.is_near:
                return light
            whole = trace_illumination(*given, False, self.terms.seed + seed)[0] if shadows else light
            return light.far(whole, self.look(fitted).pixel)

        key = self.near, self.veil, shadows, rays, fitted, skip, seed, self.nearer
        light = self.memo("trace", key, work, 2)
        return self.memo("aim", (light, self.aim), lambda: self.aim(light), 2) if self.aim else light

    def _placed(self, fitted: Fitted | None, skip: float, nearer: float) -> tuple[RingScene, float]:
        """Give the scene with the surface of a fit, or what stands for it; and what length counts as none [scene units]."""
        if fitted is None:
            return self.surface.placeholder(nearer), 0.0
        return self.surface.follow(fitted, skip, nearer)

    @property
    def distance_is_unknown(self) -> bool:
        """Whether LEDs are near to a surface that a rectangle stands for, somewhere."""
        return self.near and not self.ring.shape_is_known

    def nearer_light(self, fitted: Fitted, row: np.ndarray, reach: float) -> Nearer:
        """Give the light of some rows of a fit's problem if the surface is nearer to the camera, up to `reach`, or farther.

        Less far where it would lie beside or behind LEDs with a surface, which shine to one side only.
        """
        surface = fitted if self.moved else None
        pixel = owned(type(fitted.problem.pairs.first), fitted.problem.pixel[row])

        def light(by: float) -> Illumination:
            scene, _ = self._placed(surface, SKIP, self.nearer + by)
            return trace_illumination(scene, TRIAL_RAYS, False, self.terms.seed)[0].gather(pixel)

        here = light(0.0)
        for _ in range(MOST_HALVED):
            nearer = Nearer(reach, (light(-reach), here, light(reach)))
            if nearer.is_lit:
                break
            reach /= 2
        return nearer

    def illumination(self, fitted: Fitted | None = None, rays: int | None = None) -> Illumination:
        """Give the light that is modelled, on the surface of a fit where that counts, with `rays` per pixel there."""
        surface = fitted if self.on_fit else None
        shadows = self.shadows == ("estimate" if surface and self.shadows != "scene" else "scene")
        light = self.trace(shadows, rays if surface and rays else self.rays, surface)
        if self.shadows == "latent" and fitted:
            light = light.seen(self.seen(fitted).everywhere(fitted.problem.pixel, self.mask.size))
        if not (self.indirect and fitted):
            return light

        def work():
            follows = (
                surface is not None or not self.ring.shape_is_known
            )  # a placeholder sends nothing to itself
            scene, free = self._placed(fitted, SKIP, self.nearer) if follows else (self.ring, 0.0)
            depth, seed = self.ring.integrator.max_depth, self.terms.seed
            return replace(light, indirect=trace_indirect(scene, fitted.maps, light, depth, seed, free))

        return self.memo("indirect", (light, fitted), work)

    def seen(self, fitted: Fitted) -> Seen:
        """Give what pixels see of the LEDs, as their events tell.

        Once lobes or a rough matt part are known nothing more is hidden: but what seemed so for want of lobes is seen again.
        """

        def work():
            problem, before = self._unhidden(fitted)
            if self.gloss is None and self.rough is None:
                traced = self._traced(fitted, problem)
                given = problem, fitted.solution, before, traced, self.ring.shape_is_known
                return find_visibility(*given, self.enough)
            untold, solution = problem.fired & ~fitted.problem.fired, self._under_lobes(fitted.solution)
            if self.gloss is None:
                return Seen(before, solution.all_theta, untold)
            alike = replace(self, gloss=self.gloss.commonest(problem.n_pixel))
            surfaces = [world._with_surface(problem) for world in (self, alike)]
            traced = self._traced(fitted, problem)
            share, theta = unhide(surfaces, solution, before, traced, self.ring.shape_is_known)
            return Seen(share, theta, untold & (share < 1).any(axis=0))

        key = fitted, self.moved, self.recording, self.aim, self.gloss, self.rough
        return fitted.seen or self.memo("seen", key, work, 2)

    def with_seen(self, fitted: Fitted) -> Fitted:
        """Give a fit with what its pixels see of the LEDs, where events tell that, so that it is not asked again."""
        return replace(fitted, seen=self.seen(fitted)) if self.shadows == "latent" else fitted

    def left_open(self, fitted: Fitted) -> np.ndarray:
        """Give the covariances of maps that not knowing what pixels see leaves open, see `visibility.left_open`."""
        problem, before = self._unhidden(fitted)
        traced = self._traced(fitted, problem)
        return left_open(problem, fitted.solution, before, traced, self.ring.shape_is_known)

    def _unhidden(self, fitted: Fitted) -> tuple[Problem, np.ndarray]:
        """Give the problem of a fit under light that nothing hides, and the visibility (n_led, n_pixel) that was modelled."""
        free = self.trace(False, self.rays, fitted if self.moved else None)
        problem = make_problem(self.recording, fitted.problem.told, free, self.mask, self.hot)
        whole = replace(problem.illumination, indirect=fitted.problem.illumination.indirect)
        # Not the ratio of its light to this: LEDs may have been found stronger or weaker since
        shape, before = (problem.illumination.n_led, problem.n_pixel), fitted.problem.visible
        return replace(problem, illumination=whole), np.ones(shape, np.float32) if before is None else before

    def _traced(self, fitted: Fitted, problem: Problem) -> np.ndarray:
        """Trace what each pixel sees of the LEDs (n_led, n_pixel), on the surface of a fit where the shape is not known."""
        surface = None if self.ring.shape_is_known else fitted
        here = owned(type(problem.pairs.first), problem.pixel)
        plain, shadowed = (self.trace(s, TRIAL_RAYS, surface, SURE).gather(here) for s in (False, True))
        return shadowed.share_of(plain, problem.n_pixel)

    def pairs(self, fitted: Fitted | None = None) -> Pairs:
        """Pair the events, as photoreceptors that lag show them under the light of a fit."""
        fitted = fitted if self.lag else None

        def work():
            receptors = None
            if fitted:
                receptors = photoreceptors(self.recording, fitted.problem, fitted.solution, self.lag)
            try:
                return pair_events(self.recording, self.mask, receptors, self.leak)
            except InputError as error:
                raise InputError(f"{self.recording.source}: {error}") from error

        return self.memo("pairs", (self.recording, self.mask, fitted, self.leak), work)

    def problem(self, fitted: Fitted | None = None, rays: int | None = None) -> Problem:
        """Give the problem to solve; what depends on the maps follows those of a fit, if there is one."""
        light, pairs = self.illumination(fitted, rays), self.pairs(fitted)
        problem = make_problem(self.recording, pairs, light, self.mask, self.hot)
        if self.background:
            activity, teller = self.background[0], fitted or self.background[1]
            if np.array_equal(problem.pixel, teller.problem.pixel):
                problem = replace(problem, pairs=without_chance(problem, teller.solution, activity))
        if self.shadows in ("scene", "estimate"):
            surface = fitted if self.on_fit else None
            plain = self.trace(False, rays if surface and rays else self.rays, surface)
            share = light.share_of(plain, self.mask.size)[:, problem.pixel]
            pairs = unlit_by(problem.pairs, doubtful(share, light.band))
            problem = replace(problem, pairs=pairs, visible=share)
        if self.shadows == "latent" and fitted:
            seen = self.seen(fitted)
            pairs, fired = without(problem.pairs, seen.untold), problem.fired & ~seen.untold
            told = {"start": seen.theta, "visible": seen.share}
            problem = replace(problem, pairs=pairs, fired=fired, **told)
        if self.gloss is not None and fitted and problem.start is None:
            problem = replace(problem, start=self._under_lobes(fitted.solution).all_theta)
        return self._with_surface(problem)

    def _under_lobes(self, solution: Solution) -> Solution:
        """Give a solution the mean thresholds that were found with the lobes; a matt fit takes gloss for smaller ones."""
        found = self.gloss is not None and solution.threshold_prior is not None
        return solution.with_thresholds(self.gloss.log_threshold) if found else solution

    def _with_surface(self, problem: Problem) -> Problem:
        """Say of what the surface is."""
        if self.metal is None and self.rough is None and self.gloss is None:
            return problem
        Float, view = type(problem.pairs.phases), view_directions(self.ring, problem.pixel)
        metal, rough = (None if r is None else dr.opaque(Float, r) for r in (self.metal, self.rough))
        lobe = None if self.gloss is None else self.gloss.lobe(Float)
        return replace(problem, metal=metal, rough=rough, lobe=lobe, view=view)
