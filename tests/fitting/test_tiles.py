"""Recordings that are solved in tiles: which these are, and that no seam is left."""

from types import SimpleNamespace

import numpy as np
import pytest

import evsdr
from evsdr.fitting import tiles
from evsdr.metrics import angular_error_deg
from evsdr.records import Events


@pytest.fixture
def small(monkeypatch):
    monkeypatch.setattr(tiles, "AT_ONCE", 60)
    monkeypatch.setattr(tiles, "MARGIN", 3)
    monkeypatch.setattr(tiles, "ENOUGH", 100)
    monkeypatch.setattr(tiles, "BLOCK", 4)


def events(n: int, width: int, height: int) -> Events:
    k = np.arange(n)
    return Events((k % width).astype(np.uint16), (k // width % height).astype(np.uint16), k % 2, k)


def test_tiles_share_the_mask_and_overlap(small):
    mask = np.zeros((30, 20), bool)
    mask[4:28, 3:18] = True
    mask[10, 10] = False
    found = tiles.tiles_of(mask, events(600, 20, 30))
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
    assert tiles.tiles_of(mask, events(500, 10, 10)) == []
    monkeypatch.setattr(tiles, "EVENTS_AT_ONCE", 250)
    assert len(tiles.tiles_of(mask, events(500, 10, 10))) == 2
    mask[5:] = False
    assert tiles.tiles_of(mask, events(500, 10, 10)) == []  # events elsewhere count for nothing


def test_what_a_tile_tells_is_taken_over():
    whole, new = (
        evsdr.Maps(
            *(
                np.full(shape, value, kind)
                for shape, kind in (((4, 6, 3), "f4"), ((4, 6, 2), "f4"), ((4, 6), bool))
            ),
            *(np.full(shape, value, "f4") for shape in ((4, 6), (4, 6, 2), 2)),
            np.full((4, 6), value, bool),
        )
        for value in (0, 1)
    )
    own = slice(1, 3), slice(2, 6)
    found = tiles.joined(whole, new, SimpleNamespace(own=own))
    for name in (
        "normal",
        "reflectance",
        "mask",
        "normal_sigma_deg",
        "reflectance_sigma",
        "mask_reflectance",
    ):
        image = getattr(found, name)
        assert (image[own] == 1).all() and image.sum() == image[own].size


def test_a_fit_in_tiles_is_that_of_the_whole(place, small, monkeypatch):
    ring, recording = evsdr.load_scene(place / "scene.xml"), evsdr.read_recording(place / "events.h5")
    fast = evsdr.Settings(preset="fast")
    said = []
    found = evsdr.fit(ring, recording, fast, progress=lambda stage, share: said.append(stage))
    assert any(stage.startswith("tiles, 2 of ") for stage in said)
    monkeypatch.setattr(tiles, "AT_ONCE", 10**6)
    whole = evsdr.fit(ring, recording, fast)
    assert "tiles" in found.summary["seconds"] and "tiles" not in whole.summary["seconds"]
    for name in ("events", "pairs", "pixels_solved"):
        assert found.summary["numbers"][name] == whole.summary["numbers"][name]
    assert len(found.solution.theta) == whole.summary["numbers"]["pixels_solved"]
    both = found.maps.mask & whole.maps.mask
    assert both.sum() > 0.95 * whole.maps.mask.sum()
    apart = angular_error_deg(found.maps.normal, whole.maps.normal)[both]
    assert np.median(apart) < np.median(whole.maps.normal_sigma_deg[both])
