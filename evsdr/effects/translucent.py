"""Translucent surfaces: named and paid for in sigma, as no event of a ring of one polar angle can tell them from matt ones.

Light that goes through a surface goes on behind the horizon, R (n . l + w) / (1 + w) for n . l > -w. Where l . a is the same k for
all LEDs, a the axis of the ring, that is matt light of another normal and reflectance,

    n' = (n + (w / k) a) / s,   R' = R s / (1 + w),   s = |n + (w / k) a|:

the surface looks flatter than it is, and never steeper than tan = k / w. What remains to tell is reflectance: on a thing of one
material R' falls with the tilt as s does. The surer half of the pixels is asked, as normals and reflectances that are wrong err together.
Less of that is needed of a thing whose outline looks outward and yet not steep, as one does that is cut off there, or translucent.
"""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from evsdr.effects.effect import Decision
from evsdr.effects.payment import wider
from evsdr.effects.world import Fitted, World
from evsdr.model.illumination import Illumination
from evsdr.records import Maps

NAME = "translucency"
WRAPS = np.arange(0.0, 0.85, 0.05)
UNEVEN = 0.03  # scatter of l . a from which events tell
# Scatter of log reflectance that many materials have. Measured (48 pixels, unknown shapes): sculptures of one material up to 0.20, whose
# pixels are that noisy, blobs of several 0.23 and more
TEXTURED = 0.22
FLOOR = 0.003  # of that, of what fits make wrong
TOGETHER = 25.0  # pixels that err together; guessed
BEYOND = 0.02  # share of pixels that may look steeper than they can, by error
# Log likelihood, wrap, and wrap times the share of the scatter that goes with it, from which it is named. Measured on four sculptures of
# unknown shape, 48 pixels: the last is 0.03 at most of matt ones, whose steepest pixels allow no wrap above 0.25, and 0.06 to 0.12 of those
# of wraps of 0.3 and 0.5 that gain as much; on other recordings of them half of these are named, no matt one. Of matt bumps with random
# square texels 0.6 % are named; 3.3 % were up to a scatter of 0.15, without the last
LEAST_GAIN, LEAST_WRAP, LEAST_FALL = 1.2, 0.2, 0.05
# Tilt [deg] that a tenth of an outline's pixels exceed, of those that look outward. Measured on five sculptures (48 pixels, unknown shape):
# 65 to 78 of matt ones, 47 to 57 of wrap 0.3, 39 to 47 of wrap 0.5
FLAT_DEG = (38.0, 60.0)
# Cosine, guessed; share of the outline that must be so: 0.57 to 0.83 of these sculptures
OUTWARD, MOST_OF_THEM = 0.8, 0.5
# Then needed in place of LEAST_GAIN and LEAST_FALL; measured: nearly all these have 0.45 and 0.025 or more. Of matt caps that end at tilts
# of 45 to 55 degrees, with random square texels, 5.7 % are named, 3.0 % without this
GAIN_AT_OUTLINE, FALL_AT_OUTLINE = 0.3, 0.02
RIM_DEG = 68.0  # true tilt of what is that steep there; measured on them: with it, wraps are found that are true on average
BLUR = 1.5  # by which an outline's direction is seen [pixels]; guessed


@dataclass(frozen=True)
class Translucent:
    """What light that goes on behind the horizon makes of maps.

    Attributes
    ----------
    wrap : float
        w.
    axis : (3,) float
        a.
    cosine : float
        k.
    """

    wrap: float
    axis: np.ndarray
    cosine: float

    def real(self, normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Give the normals (..., 3) that look like others, and R / R' (...)."""
        lift = self.wrap / self.cosine
        along = normal @ self.axis
        length = lift * along + np.sqrt(np.maximum(1 - lift**2 * (1 - along**2), 0))
        real = length[..., None] * normal - lift * self.axis
        size = np.linalg.norm(real, axis=-1, keepdims=True)
        return real / np.maximum(size, 1e-9), (1 + self.wrap) / np.maximum(length, 1e-3)

    def pay(self, maps: Maps) -> Maps:
        """Add to the sigmas what maps are off by if it is true."""
        real, factor = self.real(maps.normal.astype(float))
        turn = np.degrees(np.arccos(np.clip(np.sum(real * maps.normal, axis=-1), -1, 1)))
        return wider(maps, turn, np.abs(factor - 1)[..., None])


class Translucency:
    """Surfaces that look flatter than they are."""

    name, option, when = NAME, "", "last"

    def decide(self, asked: str, world: World, fitted: Fitted) -> Decision:
        """Ask the reflectances."""
        axis = ring_axis(fitted.problem.illumination)
        if not world.terms.thorough or world.metal is not None or world.ring.constant_light == 0:
            return Decision(NAME, False, "not looked for")
        if axis is None:
            return Decision(NAME, False, "not looked for: LEDs of several polar angles tell it")
        wrap, gain, fall = flattening(fitted.maps, *axis)
        tilt = outline_tilt(fitted.maps, world.mask, axis[0])
        flat = tilt is not None and FLAT_DEG[0] < tilt < FLAT_DEG[1]
        least = (GAIN_AT_OUTLINE, FALL_AT_OUTLINE) if flat else (LEAST_GAIN, LEAST_FALL)
        if gain < least[0] or wrap < LEAST_WRAP or wrap * fall < least[1]:
            return Decision(
                NAME, False, "none: reflectance does not fall with the tilt", found={"gain": gain}
            )
        if flat:
            wrap = max(wrap, outline_wrap(tilt, axis[1]))  # reflectances of few pixels tell it badly
        why = f"reflectance falls with the tilt, as that of a translucent surface of wrap {wrap:.2g} does"
        why += f", and the outline looks no steeper than {tilt:.0f} degrees" if flat else ""
        doubt = (
            f"{why}: light may go on behind the horizon, and the surface be steeper than it looks. Sigmas allow for that; LEDs of "
            "another polar angle would tell."
        )
        found, answer = {"wrap": wrap, "gain": gain}, Translucent(wrap, *axis)
        return Decision(
            NAME, False, f"not modelled, paid for in sigma: {why}", None, found, answer, doubt=doubt
        )

    def model(self, world: World, decision: Decision) -> World:
        """Leave it: no event tells it."""
        return world


def ring_axis(light: Illumination) -> tuple[np.ndarray, float] | None:
    """Give the axis (3,) of a ring of one polar angle, and its cosine; None if there are several."""
    direction = np.array([[np.mean(np.array(c)) for c in d] for d in light.direction])
    axis = direction.mean(axis=0)
    axis /= np.linalg.norm(axis)
    cosine = direction @ axis
    return None if np.std(cosine) > UNEVEN or cosine.mean() < UNEVEN else (axis, float(cosine.mean()))


def outline_tilt(maps: Maps, mask: np.ndarray, axis: np.ndarray) -> float | None:
    """Give the tilt [deg] that a tenth of the outline's pixels exceed; None where few of them look outward, or few are seen."""
    rim = mask & maps.mask & ndimage.binary_dilation(~mask, np.ones((3, 3)))
    if np.count_nonzero(rim) < TOGETHER:
        return None
    down, right = np.gradient(ndimage.gaussian_filter(mask.astype(float), BLUR))
    out, normal = np.stack([-right, down], axis=-1)[rim], maps.normal[rim].astype(float)
    length = np.linalg.norm(out, axis=-1) * np.linalg.norm(normal[:, :2], axis=-1)
    outward = np.sum(out * normal[:, :2], axis=-1) > OUTWARD * length
    if np.mean(outward) < MOST_OF_THEM:
        return None
    return float(np.quantile(np.degrees(np.arccos(np.clip(normal[outward] @ axis, -1, 1))), 0.9))


def outline_wrap(tilt: float, cosine: float) -> float:
    """Give the wrap under which an outline looks that steep [deg]."""
    rim, tilt = np.radians(RIM_DEG), np.radians(tilt)
    return float(cosine * (np.sin(rim) / np.tan(tilt) - np.cos(rim)))


def flattening(maps: Maps, axis: np.ndarray, cosine: float) -> tuple[float, float, float]:
    """Find the wrap under which reflectance is most alike; gives also its gain in log likelihood, and the share of scatter that goes."""
    there = maps.mask & maps.mask_reflectance
    if np.count_nonzero(there) < TOGETHER:
        return 0.0, 0.0, 0.0
    tilted = maps.normal[there].astype(float) @ axis
    flattest = max(np.quantile(tilted, BEYOND), 0.0)
    wraps = WRAPS[WRAPS * np.sqrt(1 - flattest**2) <= cosine * flattest + 1e-6]
    there &= maps.normal_sigma_deg <= np.median(maps.normal_sigma_deg[there])
    log = np.log(np.maximum(maps.reflectance[there].astype(float), 1e-6))
    log, normal = np.median(log - np.median(log, axis=0), axis=1), maps.normal[there].astype(float)

    def scatter(wrap):
        own = log + np.log(Translucent(wrap, axis, cosine).real(normal)[1])
        return np.median(np.abs(own - np.median(own)))

    scatters = np.array([scatter(w) for w in wraps])
    best = int(np.argmin(scatters))
    if scatters[0] > TEXTURED:
        return 0.0, 0.0, 0.0
    gain = len(log) / TOGETHER * np.log((scatters[0] + FLOOR) / (scatters[best] + FLOOR))
    return float(wraps[best]), float(gain), float(1 - scatters[best] / max(scatters[0], FLOOR))
