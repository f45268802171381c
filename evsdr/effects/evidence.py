"""What speaks for a hypothesis on a set-up, and whether that leaves no doubt: events, a known shape, curl."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from evsdr.effects.doubts import Doubts, known_shape
from evsdr.effects.hollow import moved
from evsdr.effects.hypotheses import Hypothesis
from evsdr.effects.orientation import bends_of, turn_between
from evsdr.effects.trials import Trial
from evsdr.light.camera import camera_geometry
from evsdr.metrics import angular_error_deg
from evsdr.records import Maps
from evsdr.solve.noise import MEDIAN_TO_SIGMA

if TYPE_CHECKING:
    from evsdr.effects.world import Fitted, World

# Of log likelihood of an event pair: what convicts, measured (right hypotheses gain 0.4 and more, wrong ones that explain
# the events 0.12 at most), and what means nothing
GAIN, SLIP = 0.25, 0.02
# Event pairs for each unknown of a pixel from which small residuals convict: of fewer any model leaves little. Guessed; measured: 1.2 (a grey relief
# under LEDs at 25 degrees, `experiments.draws` 1069) took LEDs that fade for such that switch; a sphere before an EVK4 with one threshold has 4
ROOM = 2.0
LOST = 0.15  # share of the events that stay unexplained; measured: 0.03 under right hypotheses, 0.27 under hard switches, which a lag follows that trials lack
SHAPE_DEG = 5.0  # by which normals of a known shape may be off; guessed
# Of log likelihood of a pixel's normal, and the part of the contradiction that may remain; guessed
NORMAL_GAIN, LESS = 1.0, 0.5
# Share of curl that may remain; guessed, between what was measured: 0.03 under right hypotheses (experiments.setup_errors, relief), 0.32
# where the order was interleaved and is taken for a rolled one
CURL_LEFT = 0.2
# Share of curl that noise makes, and what bends count beside normals of a known shape; guessed
CURL_FLOOR, CURL_WEIGHT = 0.03, 2.0
# Factor from which thresholds that shall be known are told wrong, guessed, and how many times their scatter over the pixels
# its logarithm must be; measured: 2.8 and more where they are told half or double, 1.5 under hard switches
WRONG_THRESHOLD, CONSISTENT = 1.5, 2.0
RIGID = 0.9  # how well normals under a hypothesis must be those as told, turned, to tell its curl


@dataclass(frozen=True)
class Score:
    """What speaks for a hypothesis, in log likelihood over what is told.

    Attributes
    ----------
    trial : Trial
    events : float
        Of an event pair.
    shape, curl : float
        Of a pixel's normal, by a known shape, and by the curl of the slopes.
    shape_deg : float
        Median angle to the known shape [deg]; 0 where none is known.
    curl_share : float
        See `Bends.curl`; that as told where it is not known.
    missing : float
        Share of the event pairs as told that are none under it, as with times that leave no room for them.
    """

    trial: Trial
    events: float = 0.0
    shape: float = 0.0
    curl: float = 0.0
    shape_deg: float = 0.0
    curl_share: float = 0.0
    missing: float = 0.0

    @property
    def lost(self) -> float:
        """Give the share of the events that stay unexplained."""
        return self.missing + (1 - self.missing) * self.trial.lost

    @property
    def total(self) -> float:
        """Give the log likelihood of a pixel."""
        clear = np.sign(self.events) * max(abs(self.events) - SLIP, 0)
        pairs = len(self.trial.residual) / len(self.trial.place)
        return float(clear * pairs + self.shape + self.curl)


class Judge:
    """Scores hypotheses on one fit."""

    def __init__(self, world: "World", fitted: "Fitted", doubts: Doubts, told: Trial):
        self.maps, self.doubts, self.shape = fitted.maps, doubts, known_shape(world)
        self.camera, _ = camera_geometry(world.ring.sensor)
        self.n_unknown = fitted.solution.theta.shape[1] + (0 if told.gain is None else 2)
        self.told = Score(told, shape_deg=self._angle(told)[0], curl_share=doubts.bends.curl())

    def score(self, hypothesis: Hypothesis, trial: Trial) -> Score:
        """Compare with what is told."""
        told, share = self.told, self._curl(hypothesis, trial)
        curl = CURL_WEIGHT * np.log((told.curl_share + CURL_FLOOR) / (share + CURL_FLOOR))
        angle, shape = self._angle(trial)
        shape -= self._angle(told.trial)[1]
        missing = max(1 - len(trial.residual) / len(told.trial.residual), 0.0)
        return Score(trial, told.trial.cost - trial.cost, shape, float(curl), angle, share, missing)

    def _angle(self, trial: Trial) -> tuple[float, float]:
        """Give the median angle to a known shape [deg], and the log likelihood of a pixel's."""
        if self.shape is None:
            return 0.0, 0.0
        angle = angular_error_deg(trial.normal, self.shape.reshape(-1, 3)[trial.place])
        return float(np.median(angle)), -float(np.mean(np.log1p((angle / SHAPE_DEG) ** 2)))

    def _curl(self, hypothesis: Hypothesis, trial: Trial) -> float:
        """Give the share of curl in the bends of all pixels, if normals turn as those of the trial do."""
        if hypothesis.move is not None:
            moved = (hypothesis.move(a) for a in (self.maps.normal.astype(float), self.maps.mask))
            return bends_of(*moved, self.camera).curl()
        turn, rigid = turn_between(self.told.trial.normal[:, :2], trial.normal[:, :2])
        return self.doubts.bends.curl(turn) if rigid > RIGID else self.told.curl_share

    def turned(self, hypothesis: Hypothesis, trial: Trial) -> Maps:
        """Give the maps under a hypothesis that turns image or normals."""
        if hypothesis.move is not None:
            return moved(self.maps, hypothesis)
        turn, _ = turn_between(self.told.trial.normal[:, :2], trial.normal[:, :2])
        normal = self.maps.normal.copy()
        normal[..., :2] = normal[..., :2] @ turn.T
        return replace(self.maps, normal=normal)

    def _is_tested(self, trial: Trial) -> bool:
        """Tell whether a trial has more event pairs than whatever is tried explains."""
        return len(trial.residual) > ROOM * self.n_unknown * len(trial.place)

    def convicts(self, score: Score) -> str:
        """Give the evidence if it leaves no doubt; else nothing."""
        told, scale, before = self.told, score.trial.scale, self.told.trial.scale
        less = (
            f"with that, {scale:.1%} of a threshold stay unexplained of its events, and {before:.1%} as told"
        )
        gain = score.trial.gain if told.trial.gain is None else None
        if gain is not None:
            if not consistently_wrong(gain):
                return ""
            on, off = np.median(gain, axis=0)
            less = f"events say {on:.2g} times C_on and {off:.2g} times C_off; {less}"
        if score.events > GAIN and score.lost < LOST and self._is_tested(score.trial):
            return less
        if score.events < -SLIP:
            return ""
        if self.doubts.shape and score.shape > NORMAL_GAIN and score.shape_deg < LESS * told.shape_deg:
            return (
                f"with that, fitted normals are {score.shape_deg:.0f} degrees off those of the object's geometry, and "
                f"{told.shape_deg:.0f} as told"
            )
        least = min(LESS * told.curl_share, CURL_LEFT)
        if self.doubts.curl and score.curl > NORMAL_GAIN and score.curl_share < least:
            return (
                f"with that, the curl that no surface has is {score.curl_share:.0%} of the bends of the fitted normals, "
                f"and {told.curl_share:.0%} as told"
            )
        return ""


def consistently_wrong(gain: np.ndarray) -> bool:
    """Tell whether factors (n_pixel, 2) on told thresholds say the same in most pixels."""
    log = np.log(gain)
    middle = np.median(log, axis=0)
    scatter = MEDIAN_TO_SIGMA * np.median(np.abs(log - middle), axis=0)
    far = np.abs(middle) > np.maximum(np.log(WRONG_THRESHOLD), CONSISTENT * scatter)
    return bool(far.any())
