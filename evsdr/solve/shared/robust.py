"""How well what all pixels share is known where the model of the events is not quite right.

Curvature of the likelihood tells the scatter of what is found if the model is true. What it has wrong, as noise of
photoreceptors that is not quite the real one's, is the same in all pixels and rounds, so neither tells of it; but it
differs between kinds of events: soon or long after the one before, of its polarity or the other, early or late in a slot.
Scores of each kind would add up to about 0. What they add up to instead counts as an error that all events of a kind have in
common, beside the scatter of single ones: the sandwich of White (1982) with clusters of two kinds (Cameron, Gelbach
and Miller 2011, without the term of their intersection; where the model is true it makes sigma up to 1.4 times too large).
"""

import numpy as np

# Kinds by the time since the event before, and by the part of a slot; guessed
N_WAIT, N_PART = 5, 4


def kinds(events: tuple) -> np.ndarray:
    """Give the kind of each event (n_event,) int64, from 0; `events` as in `kernel.pixel_sums`."""
    _, at, gap, polarity, *_ = events
    gap, at, polarity = (np.append(of[:1], of[:-1]) for of in (gap, at, polarity))
    waited = np.searchsorted(np.quantile(gap, np.arange(1, N_WAIT) / N_WAIT), gap) if len(gap) else gap
    again = polarity == np.append(0, polarity[:-1])
    part = np.minimum(N_PART * (at - np.floor(at)), N_PART - 1).astype(np.int64)
    return (2 * np.asarray(waited, np.int64) + again) * N_PART + part


def covariance(
    slope: np.ndarray, response: np.ndarray, vectors: np.ndarray, complement: np.ndarray
) -> np.ndarray:
    """Give that of what is shared (n_free, n_free), along the basis, where the posterior has its maximum.

    Parameters
    ----------
    slope : (n_pixel, n_kind, n + m)
        Of the cost of each kind of event by the n unknowns of a pixel and what is shared.
    response : (n_pixel, n, n_free)
        Of the maps to what is shared.
    vectors : (m, n_free)
        Along which that may move.
    complement : (n_free, n_free)
        What is known of it.
    """
    n, known = response.shape[1], np.linalg.inv(complement)
    of_maps = np.tensordot(slope[:, :, :n].transpose(1, 0, 2), response, 2)
    errors = (slope[:, :, n:].sum(axis=0) @ vectors + of_maps) @ known
    return known + errors.T @ errors
