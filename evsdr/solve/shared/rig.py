"""What all pixels share: its values, and what is told of them."""

from dataclasses import dataclass

import numpy as np

TIMES = ("tau", "dark", "noise", "shift", "refractory", "leak", "pole")
NAMES = ("powers", *TIMES, "thresholds", "distance", "directions")
CONSIDERED = "pole"  # known only as told, which sigmas of the others hold (Schmidt 1966)
N_TIMING = len(TIMES) + 3  # columns of the border between powers and directions
GROUPS = {  # what a user can leave out, and what is decided on together
    "powers": ("powers",),
    "lag": ("tau", "dark", "noise"),
    "shift": ("shift",),
    "refractory": ("refractory",),
    "leak": ("leak",),
    "thresholds": ("thresholds",),
    "distance": ("distance",),
    "directions": ("directions",),
}
NOT_NEGATIVE = ("tau", "dark", "noise", "refractory")


@dataclass(frozen=True)
class Rig:
    """Values of what all pixels share, or their standard deviations; times in slots.

    Attributes
    ----------
    log_power : (n_led,) float
        Logarithm of each LED's power, relative to what is told.
    tau : float
        Time constant of photoreceptors at I = 1.
    dark : float
        Light that their dark current amounts to.
    noise : float
        Standard deviation of log I behind them.
    shift : float
        By which all times are late.
    refractory : float
        Refractory period.
    leak : float
        Rise of what the comparators see, per slot since the reference was memorised [log I].
    pole : float
        How fast that noise forgets, see `events.lead`; never found, but considered in sigmas.
    log_threshold : (2,) float
        Mean logarithms of C_on and C_off over the pixels, relative to what is told.
    tilt : (n_led, 2) float
        By which each LED's direction is turned, along `across` [rad].
    distance : float
        By how much the surface is nearer to the camera, so to near LEDs, than what stands for it [scene units].
    """

    log_power: np.ndarray
    tau: float
    dark: float
    noise: float
    shift: float
    refractory: float
    leak: float
    pole: float
    log_threshold: np.ndarray
    tilt: np.ndarray
    distance: float = 0.0

    @classmethod
    def of(cls, vector: np.ndarray, n_led: int) -> "Rig":
        """Read a vector, as columns of the border are ordered."""
        times, rest = vector[n_led : n_led + len(TIMES)], vector[n_led + len(TIMES) :]
        return cls(vector[:n_led], *times.tolist(), rest[:2], rest[3:].reshape(n_led, 2), float(rest[2]))

    @property
    def vector(self) -> np.ndarray:
        """All values (3 n_led + N_TIMING,)."""
        times = [getattr(self, name) for name in TIMES]
        return np.concatenate([self.log_power, times, self.log_threshold, [self.distance], self.tilt.ravel()])


@dataclass(frozen=True)
class Told:
    """How well what is told is known: one standard deviation each.

    All but the refractory period and the thresholds are told as 0, or as the scene has them.

    Attributes
    ----------
    powers : float
        Of the logarithm of an LED's power, against the others of its band: the gain of a band is as told.
    tau_us, dark, noise, shift_us, refractory_us : float
        As in `Rig`, times in us.
    leak : float
        Of the rise of log I [1/s].
    pole : float
        As in `Rig`.
    thresholds : float
        Of the mean logarithm of each threshold.
    directions_deg : float
        Of an LED's direction, each way.
    distance : float
        Of that of the surface [scene units].
    """

    powers: float = 0.05
    tau_us: float = 100.0
    dark: float = 0.03
    noise: float = 0.05
    shift_us: float = 30.0
    refractory_us: float = 15.0
    leak: float = 0.05
    pole: float = 1.0
    thresholds: float = 0.3
    directions_deg: float = 0.5
    distance: float = 1.0

    def tolerance(self, slot_us: float) -> dict[str, float]:
        """Give the standard deviation by name, in the units of `Rig`."""
        return dict(
            powers=self.powers,
            tau=self.tau_us / slot_us,
            dark=self.dark,
            noise=self.noise,
            shift=self.shift_us / slot_us,
            refractory=self.refractory_us / slot_us,
            leak=self.leak * 1e-6 * slot_us,
            pole=self.pole,
            thresholds=self.thresholds,
            distance=self.distance,
            directions=np.radians(self.directions_deg),
        )


@dataclass(frozen=True)
class Basis:
    """In which directions what is shared may move.

    Attributes
    ----------
    vectors : (3 n_led + N_TIMING, n_free) float
        Orthonormal columns.
    owner : (n_free,) str
        The name of each.
    """

    vectors: np.ndarray
    owner: np.ndarray

    @classmethod
    def of(cls, names: tuple[str, ...], band: list[int]) -> "Basis":
        """Collect the directions of some of `NAMES`.

        No recording tells the gain of a band, so the log powers of its LEDs add up to 0.
        """
        n_led = len(band)
        one = np.eye(3 * n_led + N_TIMING)
        found: dict[str, list] = {name: [one[n_led + k]] for k, name in enumerate(TIMES)}
        found["thresholds"] = list(one[n_led + len(TIMES) : n_led + len(TIMES) + 2])
        found["distance"] = [one[n_led + N_TIMING - 1]]
        found["directions"] = list(one[n_led + N_TIMING :])
        found["powers"] = []
        for b in set(band):
            some = np.flatnonzero(np.asarray(band) == b)
            across_ones = np.linalg.svd(np.ones((len(some), 1)))[0][:, 1:]
            found["powers"] += list((one[some].T @ across_ones).T)
        rows = [(vector, name) for name in NAMES if name in names for vector in found[name]]
        vectors = np.array([vector for vector, _ in rows]).reshape(len(rows), len(one)).T
        return cls(vectors, np.array([name for _, name in rows]))


def across(direction: np.ndarray) -> np.ndarray:
    """Give two unit vectors (2, 3) across a direction (3,)."""
    first = np.cross(direction, (1.0, 0, 0) if abs(direction[0]) < 0.7 else (0, 1.0, 0))
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(direction, first)])
