"""Recordings whose rig is not as told, and the inference of what it is."""

from dataclasses import replace

import mitsuba as mi
import numpy as np

from evsdr.events.pairs import pair_events
from evsdr.metrics import angular_error_deg
from evsdr.records import Events
from evsdr.solve.problem import make_problem
from evsdr.solve.shared.infer import infer
from evsdr.solve.shared.pixels import choose, collect
from evsdr.solve.shared.posterior import Start
from evsdr.solve.shared.rig import Rig, Told
from evsdr.solve.unknowns import to_normal
from tests.support.sphere import ALONE, C_W, solve, sphere_recording

N_LED = 24
POINTS = replace(ALONE, tuning=replace(ALONE.tuning, curved=False))  # pixels see points of the surface
MOST = ("powers", "tau", "noise", "shift", "refractory", "thresholds")


def power_errors(sigma=0.1) -> np.ndarray:
    """Give log powers (24,) that add up to 0 in each of the 8 bands."""
    off = np.random.default_rng(0).normal(0, sigma, (3, 8))
    return (off - off.mean(axis=0)).ravel()


def spoilt(recording, light, log_power=0.0, late_us=0, refractory=1.0, thresholds=1.0):
    """Tell a recording wrong: LEDs that are exp(log_power) times as bright as told, events late, factors too high."""
    log_power = np.broadcast_to(log_power, N_LED)
    light = replace(light, irradiance=[mi.Float(float(np.exp(-v))) for v in log_power])
    sensor = recording.sensor
    sensor = replace(
        sensor,
        refractory_us=refractory * sensor.refractory_us,
        contrast_threshold_on=thresholds * sensor.contrast_threshold_on,
        contrast_threshold_off=thresholds * sensor.contrast_threshold_off,
    )
    events = replace(recording.events, t=recording.events.t + late_us)
    return replace(recording, events=events, sensor=sensor), light


def told_rig(recording) -> Rig:
    """Give what a recording tells."""
    times = 0.0, 0.0, 0.0, 0.0, recording.sensor.refractory_us / recording.schedule.slot_us, 0.0, 0.0
    return Rig(np.zeros(N_LED), *times, np.zeros(2), np.zeros((N_LED, 2)))


class Case:
    """A fitted recording of a sphere, some of its pixels, and the start of an inference."""

    def __init__(self, recording, light, normal, mask, thresholds=False):
        self.recording = recording
        self.problem = make_problem(recording, pair_events(recording, mask), light, mask)
        self.solution = solve(self.problem, POINTS, thresholds=thresholds)
        self.row = choose(self.problem, self.solution, 200)
        self.pixels = collect(recording, self.problem, self.solution, self.row)
        self.truth, self.told = normal[mask][self.row], told_rig(recording)

    @classmethod
    def sphere(cls, size=20, wrong=None, thresholds=False, **options):
        recording, light, normal, mask = sphere_recording(size, **options)
        return cls(*spoilt(recording, light, **wrong or {}), normal, mask, thresholds)

    def infer(self, names=MOST, told=Told()):
        prior = self.solution.threshold_prior or (0.0, 0.0, 1.0, 1.0)
        first = replace(self.told, log_threshold=np.array(prior[:2]))
        if "tau" in names:
            first = replace(first, tau=20 / self.recording.schedule.slot_us, noise=0.005)
        theta = self.solution.all_theta[self.row].astype(float)
        start = Start(theta, first, np.array(prior[2:]), self.solution.noise)
        return infer(self.pixels, start, self.told, told, tuple(names))

    def error(self, theta=None) -> float:
        """Give the mean error of normals [deg]: of the fit, or of other unknowns."""
        theta = self.solution.theta[self.row] if theta is None else theta
        return float(angular_error_deg(to_normal(theta), self.truth).mean())


def dark_events(signal, schedule, n_round, tau_us, dark, threshold, step_us=4.0, noise=0.02):
    """Step pixels with a dark current, tau / (I + dark) dv/dt = log I - v, without refractory period; thresholds scatter."""
    n_slot, shape = len(schedule.order), signal.shape[1:]
    light = signal[schedule.order].reshape(n_slot, -1) + C_W
    v = np.log(light[0])
    rng = np.random.default_rng(0)
    reference, limit, found = v.copy(), threshold * (1 + noise * rng.normal(size=v.shape)), []
    for k in range(round(n_round * n_slot * schedule.slot_us / step_us)):
        slot, fade = divmod((k + 0.5) * step_us / schedule.slot_us, 1)
        now = (1 - fade) * light[int(slot) % n_slot] + fade * light[int(slot + 1) % n_slot]
        before, v = v, np.log(now) + (v - np.log(now)) * np.exp(-step_us * (now + dark) / tau_us)
        away = v - reference
        for pixel in np.flatnonzero(np.abs(away) >= limit):
            sign = np.sign(away[pixel])
            reference[pixel] += sign * limit[pixel]
            limit[pixel] = threshold * (1 + noise * rng.normal())
            part = (reference[pixel] - before[pixel]) / (v[pixel] - before[pixel])
            found.append((k * step_us + part * step_us, pixel, sign > 0))
    t, pixel, on = np.array(sorted(found)).T
    y, x = np.divmod(pixel.astype(int), shape[1])
    t = np.rint(t).astype(np.int64)
    order = np.argsort(t, kind="stable")
    return Events(*(a[order] for a in (x.astype(np.uint16), y.astype(np.uint16), on.astype(np.int8), t)))
