"""Which tiles a recording is divided into: they share the mask, overlap, and hold few enough events."""

from types import SimpleNamespace

import numpy as np
import pytest

from evsdr.fitting import tiling
from evsdr.records import Events


@pytest.fixture
def small(monkeypatch):
    monkeypatch.setattr(tiling, "AT_ONCE", 60)
    monkeypatch.setattr(tiling, "MARGIN", 3)


def events(n: int, width: int, height: int) -> Events:
    k = np.arange(n)
    return Events((k % width).astype(np.uint16), (k // width % height).astype(np.uint16), k % 2, k)


def test_tiles_share_the_mask_and_overlap(small):
    mask = np.zeros((30, 20), bool)
    mask[4:28, 3:18] = True
    mask[10, 10] = False
    found = tiling.tiles_of(mask, events(600, 20, 30))
    told, solved = np.zeros((2, *mask.shape), int)
    for tile in found:
        told[tile.own] += 1
        solved[tile.solved] += 1
        assert np.count_nonzero(mask[tile.own]) < 1.3 * 60
    assert (told[mask] == 1).all() and (solved[mask] >= 1).all() and solved.max() >= 4
    top = found[0]
    assert top.solved[0].stop == top.own[0].stop + 3 and top.solved[0].start == top.own[0].start - 3


def test_a_tile_is_enough_for_few_pixels_and_events(monkeypatch):
    mask = np.ones((10, 10), bool)
    assert tiling.tiles_of(mask, events(500, 10, 10)) == []
    monkeypatch.setattr(tiling, "EVENTS_AT_ONCE", 250)
    assert len(tiling.tiles_of(mask, events(500, 10, 10))) == 2
    mask[5:] = False
    assert tiling.tiles_of(mask, events(500, 10, 10)) == []  # events elsewhere count for nothing


def test_how_many_are_expected(small):
    """Every pixel fires: as many as of a mask of all."""
    fired = SimpleNamespace(sensor=SimpleNamespace(width=20, height=30), events=events(600, 20, 30))
    assert tiling.expected(fired) == len(tiling.tiles_of(np.ones((30, 20), bool), fired.events)) > 5
    assert tiling.expected(SimpleNamespace(sensor=fired.sensor, events=events(50, 20, 30))) == 0
