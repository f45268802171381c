"""What residuals of neighbouring pixels have in common: the model's own error, which priors do not average away.

Noise of events is independent from pixel to pixel, and where model and priors hold what is left of the light of two
neighbours goes together less than not at all. What does go together is light that the model lacks, or a surface that
priors make too smooth: a discrepancy (Kennedy and O'Hagan, "Bayesian calibration of computer models", 2001). It is taken for
as likely in what maps can explain as in what they can't, so that what noise does to a pixel, neighbours aside, counts once
more by the share of its noise that neighbours have in common, or by what its own residuals are larger than noise.
"""

import numpy as np
from scipy import ndimage

from evsdr.records import Signals
from evsdr.solve.unknowns import weak_prior

TOLD = 0.5  # standard deviation of log light from which events tell of an LED; guessed
WINDOW = 7  # pixels over which neighbours are compared; measured: 5 alike
FEW = 60  # pairs of neighbours that count for what is true of all; measured: 30 alike
BESIDE = ((0, 1), (1, 0), (1, 1), (1, -1))  # steps (row, column) to neighbours


def common_share(signals: Signals, mask: np.ndarray, known: np.ndarray) -> tuple[np.ndarray, float]:
    """Say which share of the noise of a pixel's light its neighbours have in common.

    Parameters
    ----------
    signals : Signals
        Of all solved pixels, or of some that lie together.
    mask : (height, width) bool
        The solved pixels.
    known : (height, width) bool
        Those whose maps are known.

    Returns
    -------
    share : (n_pixel,) float
        0 and more, of each solved pixel from those around it; where there are none, that of all.
    common : float
        That of all.
    """
    told = signals.sigma < TOLD
    off = np.where(told, signals.change / np.maximum(signals.sigma, 1e-6), 0).astype(float)
    free = np.maximum(np.count_nonzero(told, axis=1) - 1, 0)  # the mean is not told
    number = np.full(mask.shape, -1)
    number.ravel()[signals.pixel] = np.arange(len(signals.pixel))
    number[~known] = -1
    together, expected, count = np.zeros((3, mask.size))
    for p, q in _beside(number):
        product, most = np.sum(off[p] * off[q], axis=1), np.minimum(free[p], free[q])
        for at in (signals.pixel[p], signals.pixel[q]):
            np.add.at(together, at, 0.5 * product)
            np.add.at(expected, at, 0.5 * most)
            np.add.at(count, at, 0.5)
    pairs = count.sum()
    if pairs == 0 or expected.sum() == 0:
        return np.zeros(np.count_nonzero(mask)), 0.0
    common = max(together.sum() / expected.sum(), 0)

    def around(values):
        mean = ndimage.uniform_filter(values.reshape(mask.shape), WINDOW, mode="constant")
        return WINDOW**2 * mean[mask]

    of_few = FEW * expected.sum() / pairs
    share = (around(together) + of_few * common) / (around(expected) + of_few)
    return np.maximum(share, 0), float(common)


def excess_share(signals: Signals, mask: np.ndarray) -> np.ndarray:
    """Say by which share of its noise the residuals of each solved pixel (n_pixel) are larger than that; 0 where none were asked.

    Maps were fitted to them, so that noise alone makes them about half as large as itself: no share is then told.
    """
    told = signals.sigma < TOLD
    off = np.where(told, signals.change / np.maximum(signals.sigma, 1e-6), 0).astype(float)
    square = np.sum(off**2, axis=1) / np.maximum(np.count_nonzero(told, axis=1) - 1, 1)
    out = np.zeros(mask.shape)
    out.ravel()[signals.pixel] = np.maximum(square - 1, 0)
    return out[mask]


def _beside(number: np.ndarray):
    """Give the numbers of pixels and of their neighbours, from an image that has -1 where there is none."""
    height, width = number.shape
    for down, right in BESIDE:
        one = number[: height - down, max(0, -right) : width - max(0, right)]
        other = number[down:, max(0, right) : width + min(0, right)]
        both = (one >= 0) & (other >= 0)
        yield one[both], other[both]


def noise_of(own: np.ndarray) -> np.ndarray:
    """Give the covariances (n_pixel, 2 + n_band, 2 + n_band) that noise makes of maps.

    `own` are those that pixels have by their own events and weak priors. Where events tell nothing these are the priors', and
    noise does nothing: with L their precision it makes own - own L own.
    """
    precision = weak_prior(own.shape[1] - 2)[1]
    return own - np.einsum("nij,jk,nkl->nil", own, precision, own, optimize=True)
