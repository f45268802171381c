"""A sphere under a ring of far LEDs, recorded without Mitsuba, and the solver's view of it."""

import mitsuba as mi
import numpy as np

from evsdr.events.pairs import pair_events
from evsdr.events.pixel import EventPixel
from evsdr.events.simulator import simulate_events
from evsdr.metrics import angular_error_deg
from evsdr.model.illumination import Illumination
from evsdr.model.lambert import LambertianRing
from evsdr.progress import silent
from evsdr.records import Recording, Schedule, Sensor
from evsdr.solve import loop, recipes
from evsdr.solve.learning import Neighbours, PixelNoise
from evsdr.solve.problem import make_problem
from evsdr.solve.recipes import Effort
from evsdr.solve.stages import PAIRS, AllPairs, Descend, Starts
from evsdr.solve.unknowns import first_theta
from tests.support.analytic import lambert_signals, ring_directions, sphere_normals

C_W = 0.05
ALONE = Effort(priors=None)  # each pixel by itself
PAIRS_ALONE = (  # without silence, event times, and noise of single pixels
    *(Descend(30, 0.01, softness) for softness in (0.3, 0.1, 0.03, 0.01, None)),
    Starts(1, 3, 0.01),
    AllPairs(),
    Descend(30, 0.01),
    PixelNoise(PAIRS, None),
    Neighbours(None, PAIRS),
)
SPECTRUM = np.array([0.1, 0.25, 0.3, 0.4, 0.5, 0.6, 0.7, 0.6])
NO_FLAWS = dict.fromkeys(
    ("spread_on", "spread_off", "cutoff_hz", "photon_rate_per_us", "leak_hz", "hot_fraction", "hot_hz"), 0.0
)


def ring_light() -> Illumination:
    """Give the light of the ring of `analytic`: 24 far LEDs of 8 bands."""
    vectors = [mi.Vector3f(*d) for d in ring_directions().tolist()]
    return Illumination(vectors, [mi.Float(1.0)] * 24, [j % 8 for j in range(24)], mi.Float(C_W))


def record_signal(signal, seed=0, threshold=0.2, n_round=6, schedule=None, **flaws) -> Recording:
    """Record signals (n_led, H, W) by event pixels of few flaws."""
    schedule = schedule or Schedule(np.arange(len(signal), dtype=np.int32), 10_000.0, 1.0)
    pixel = EventPixel(threshold, threshold, **(NO_FLAWS | flaws))
    events, _, _, starts = simulate_events(signal, C_W, schedule, n_round, pixel, seed=seed)
    height, width = signal.shape[1:]
    return Recording(
        events, Sensor(width, height, threshold, threshold, pixel.refractory_us), schedule, starts
    )


def sphere_recording(size: int, spectrum=SPECTRUM, dead=(), **options):
    """Give a sphere's recording, light, normals, mask; LEDs that are `dead` stay dark."""
    normal, mask = sphere_normals(size)
    signal = lambert_signals(normal, np.broadcast_to(spectrum, (size, size, 8)), ring_directions())
    signal = np.where(mask, signal, 0)
    signal[list(dead)] = 0
    return record_signal(signal, **options), ring_light(), normal, mask


def sphere_problem(size: int, event_noise: float, **options):
    """Give the solver's view of a recorded sphere, and its true normals."""
    recording, light, normal, mask = sphere_recording(size, event_noise=event_noise, **options)
    return make_problem(recording, pair_events(recording, mask), light, mask), normal[mask]


def searched_from(problem, n_early=None):
    """Give the data of a problem, and a start with frontal normals."""
    light = problem.illumination
    data = loop.data_of(LambertianRing(light), problem.pairs, light.constant_light, problem.grid, 2.0)
    frontal = np.tile([0.0, 0.0, 1.0], (problem.n_pixel, 1))
    return data, loop.start_of(data, first_theta(frontal, light.n_band, False, mi.Float), n_early)


def solve(problem, effort=ALONE, start=None, thresholds=False, model=None, recipe=None, progress=silent):
    """Solve from frontal normals by the recipe of an effort; the surface is matt by default."""
    light, model = problem.illumination, model or LambertianRing(problem.illumination)
    given = problem.pairs, light.constant_light, problem.grid, effort.width(thresholds)
    data = loop.data_of(model, *given)
    frontal = np.tile([0.0, 0.0, 1.0], (problem.n_pixel, 1))
    start = start or first_theta(frontal, light.n_band, thresholds, mi.Float)
    recipe = recipe or recipes.whole(effort)
    return loop.solve(data, recipe, loop.start_of(data, start, effort.n_early), progress)


def errors(solution, truth, spectrum=SPECTRUM):
    """Give the angles between normals [deg], and what reflectances are off by."""
    p, q = solution.theta[:, 0], solution.theta[:, 1]
    normal = np.column_stack([-p, -q, np.ones_like(p)])
    return angular_error_deg(normal, truth), np.exp(solution.theta[:, 2:]) - spectrum
