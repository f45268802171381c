"""A small fit to show, without events: a sphere with random reflectances, and signals that any numbers serve."""

from dataclasses import dataclass

import numpy as np

from evsdr.model.view import CameraGeometry
from evsdr.page.document import page
from evsdr.records import Maps, Signals, Truth
from evsdr.shape.depth import Depth
from evsdr.shape.laplacian import ends

HEIGHT, WIDTH, N_LED = 14, 18, 6
WAVELENGTH_NM = np.array([620.0, 405.0, 530.0], np.float32)  # not in order
HOSTILE = (
    "</script><script>window.hacked = 1</script><img src=x onerror='window.hacked = 1'>&\"{{style}}\u2028"
)
SUMMARY = {
    "evsdr": "0.1.0",
    "scene": "scene.xml",
    "events": "events/vase.h5",
    "solver": "lm",
    "preset": "fast",
    "verdict": "doubtful: vase.h5: only 40% of the pixels that fire are known; record more rounds.",
    "warnings": [
        "vase.h5: only 40% of the pixels that fire are known; record more rounds.",
        "another warning",
    ],
    "model": {"cast shadows": "left out: none", "scale": "absolute, by the constant light of 0.05"},
    "effects": {"cast shadows": {"modelled": False, "expected_deg": 0.01, "found": {}}},
    "numbers": {"events": 12345, "pixels_solved": 120, "pixels_known": 110},
    "sensor": {"contrast_threshold_on": {"told": 0.25, "found": 0.2512345}},
    "residual": {"relative_threshold_noise": 0.0425},
    "convergence": {"result": "settled"},
    "error": {"mae_deg": 1.25, "median_deg": 1.0, "sam_deg": 2.0, "rmse": 0.02},
    "seconds": {"solve": 2.0, "surface": 0.5},
    "misfit": "much alike everywhere",
    "command": "python -m evsdr.fit scene.xml vase.h5",
}


@dataclass(frozen=True)
class PageFit:
    """What a page shows, and the page."""

    maps: Maps
    signals: Signals
    depth: Depth
    truth: Truth
    summary: dict

    def page(self, **other) -> str:
        """Write the page."""
        return page(self.maps, self.summary | other, self.signals, self.depth, self.truth, "2026-01-02 03:04")

    @property
    def stored(self) -> np.ndarray:
        return self.depth.mask


def make_fit(seed: int = 0, height: int = HEIGHT, width: int = WIDTH, wavelength_nm=WAVELENGTH_NM) -> PageFit:
    """Give a fit of a sphere: all of it was solved, most is known, of most of that the scale."""
    rng = np.random.default_rng(seed)
    size = 2.4 / min(height, width)
    camera = CameraGeometry(False, (size, size), (width / 2, height / 2))
    x, y = (camera.points(np.zeros((height, width)))[..., k] for k in (0, 1))
    z2 = 1 - x**2 - y**2
    solved = z2 > 0.05
    normal = np.where(solved[..., None], np.stack([x, y, np.sqrt(np.maximum(z2, 0))], axis=-1), (0, 0, 1))
    mask = solved & (rng.random(solved.shape) > 0.1)
    n_band = len(wavelength_nm)
    maps = Maps(
        normal.astype(np.float32),
        np.where(solved[..., None], rng.random((height, width, n_band)), 0).astype(np.float32),
        mask,
        np.where(mask, 0.1 + rng.random(mask.shape), 180).astype(np.float32),
        np.where(mask[..., None], 0.01 + 0.1 * rng.random((height, width, n_band)), 1).astype(np.float32),
        np.asarray(wavelength_nm, np.float32),
        mask & (rng.random(mask.shape) > 0.1),
    )
    tied = tuple(
        np.logical_and(*ends(solved, axis)) & (rng.random(ends(solved, axis)[0].shape) > 0.05)
        for axis in (0, 1)
    )
    depth = Depth(
        np.where(solved, 10 - normal[..., 2], 0), solved, solved.astype(np.int32), camera, normal, tied
    )
    truth = Truth(normal, maps.reflectance + 0.01 * rng.random((height, width, n_band)), solved)
    return PageFit(maps, make_signals(solved, n_band, rng), depth, truth, SUMMARY)


def make_signals(solved: np.ndarray, n_band: int, rng) -> Signals:
    """Give signals of random numbers."""
    n = np.count_nonzero(solved)
    azimuth = 2 * np.pi * np.arange(N_LED) / N_LED
    direction = np.column_stack([np.cos(azimuth), np.sin(azimuth), np.ones(N_LED)]) / 2**0.5
    return Signals(
        pixel=np.flatnonzero(solved),
        modelled=(0.05 + rng.random((n, N_LED))).astype(np.float32),
        change=(0.1 * rng.normal(size=(n, N_LED))).astype(np.float32),
        sigma=(0.01 + 0.1 * rng.random((n, N_LED))).astype(np.float32),
        residual=(0.1 * rng.random(n)).astype(np.float32),
        count=rng.integers(0, 200, n),
        band=np.arange(N_LED) % n_band,
        direction=direction,
        constant_light=0.05,
    )
