"""Where neither scene nor mask tells which pixels are the object, those that stay dark around it are left out."""

from types import SimpleNamespace

import numpy as np
import pytest

from evsdr.effects.outline import FEWEST, Outline, outline
from tests.support.sphere import sphere_recording

SIZE = 40
Y, X = np.indices((SIZE, SIZE)) - SIZE // 2
DISK = np.hypot(X, Y) < 12
ALL = np.ones((SIZE, SIZE), bool)


def counts(lit, rng, dark_rate=0.05):
    return np.where(lit, rng.poisson(60, lit.shape), rng.poisson(dark_rate, lit.shape))


def test_what_fires_and_what_it_encloses_is_kept(rng):
    silent = np.hypot(X, Y) < 5
    assert (outline(counts(DISK & ~silent, rng), ALL, 6) == DISK).all()


def test_gaps_and_single_dark_pixels_are_no_outline(rng):
    sparse = DISK & ((X + Y) % 3 == 0)
    kept = outline(counts(sparse, rng), ALL, 6)
    assert kept[np.hypot(X, Y) < 10].all() and not kept[np.hypot(X, Y) > 15].any()


def test_a_hot_pixel_far_away_changes_nothing_else(rng):
    count = counts(DISK, rng)
    count[2, 2] = 10**5
    expected = DISK.copy()
    expected[2, 2] = True
    assert (outline(count, ALL, 6) == expected).all()


def test_what_comes_by_chance_is_not_lit_however_long_it_is_recorded(rng):
    assert (outline(counts(DISK, rng, 1.0), ALL, 6) == DISK).mean() > 0.95
    assert (outline(counts(DISK, rng, 6.0), ALL, 30) == DISK).all()


@pytest.mark.parametrize(
    "count",
    [np.zeros((SIZE, SIZE), int), np.full((SIZE, SIZE), FEWEST - 1), np.where(DISK, 60, 4)],
    ids=["silence", "few events", "events from everywhere"],
)
def test_all_is_kept_where_events_do_not_tell(count):
    assert (outline(count, ALL, 1) == ALL).all()


def test_it_reaches_the_edge_of_the_film_and_never_leaves_the_mask(rng):
    half = X >= 3
    assert (outline(counts(half, rng), ALL, 6) == half).all()
    assert (outline(counts(DISK, rng), half, 6) == (DISK & half)).all()


def test_only_an_unknown_shape_has_one_and_a_mask_stays_as_it_is():
    recording, _, _, sphere = sphere_recording(24, event_noise=0.1)

    def decide(mask, bounded, known=False):
        parts = dict(ring=SimpleNamespace(shape_is_known=known), surface=SimpleNamespace(bounded=bounded))
        return Outline().decide("auto", SimpleNamespace(recording=recording, mask=mask, **parts), None)

    assert decide(np.ones_like(sphere), True, True) is None
    close, loose = decide(sphere, True), decide(np.ones_like(sphere), True)
    assert not (close.modelled or loose.modelled or close.doubt or close.found["dark"])
    assert loose.found["dark"] == pytest.approx(np.mean(~sphere))
    assert "60% of" in Outline().of_mask(0.6).doubt and "draw it closer" in Outline().of_mask(0.6).doubt
    decision = decide(np.ones_like(sphere), False)
    assert decision.modelled and decision.found["pixels"] == np.count_nonzero(~sphere)
    assert (decision.answer == sphere).all() and str(decision.found["pixels"]) in decision.why
    full = decide(sphere, False)
    assert not full.modelled and full.why.startswith("none: ")
