"""Recordings that are solved in tiles: what each tells is joined, and no seam is left."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

import evsdr
from evsdr.effects.world import Terms
from evsdr.fitting import story, tiles, tiling
from evsdr.fitting.timeline import plan_of
from evsdr.metrics import angular_error_deg
from evsdr.progress import Whole


@pytest.fixture
def small(monkeypatch):
    monkeypatch.setattr(tiling, "AT_ONCE", 60)
    monkeypatch.setattr(tiling, "MARGIN", 3)
    monkeypatch.setattr(tiles, "ENOUGH", 100)
    monkeypatch.setattr(tiles, "BLOCK", 4)


def test_each_tile_moves_the_bar_on(small, monkeypatch):
    monkeypatch.setattr(tiles.Piece, "of", lambda fitted, tile: None)
    monkeypatch.setattr(tiles, "within", lambda world, tile: world)
    monkeypatch.setattr(tiles, "joined", lambda maps, new, tile: maps)
    monkeypatch.setattr(tiles, "together", lambda *_: None)
    told, whole = [], Whole(plan_of(True, False, 3))

    def fit(world, progress):
        progress("descent", 0.5)
        return SimpleNamespace(maps=0)

    monkeypatch.setattr(tiles, "replace", lambda world, **_: world)
    world = SimpleNamespace(memo=SimpleNamespace(only=lambda *_: None))
    tiles.solve_tiles(world, [None] * 3, None, fit, lambda what, share: told.append((what, share)))
    assert [what for what, _ in told] == [f"{k} of 3, descent" for k in (1, 2, 3)]
    shares = [whole.told(f"tiles, {what}", share) for what, share in told]
    assert shares[0] < 0.5 and np.diff(shares) == pytest.approx([48 / sum(whole.plan.stages.values())] * 2)


@dataclass(frozen=True)
class Believed:
    """What `retell` asks of a world; its problems are their shadows."""

    shadows: str
    lag: object
    known: bool = False
    gloss: object = None
    metal: object = None
    terms: Terms = Terms()

    @property
    def ring(self):
        return SimpleNamespace(shape_is_known=self.known)

    @property
    def light_follows_fit(self):
        return self.shadows == "latent"

    def problem(self, fitted=None):
        return self.shadows

    illumination = problem


@pytest.mark.parametrize(
    "world, asked",
    [
        (Believed("none", None), [("whole", "none")]),
        (Believed("none", "lag"), [("search", "none"), ("touch", "none"), ("again", "none"), "follow"]),
        (
            Believed("latent", "lag"),
            [("search", "none"), ("touch", "none"), ("sketch", "none"), "settle from none"]
            + [("relit", "latent"), ("again", "latent"), "follow"],
        ),
        (
            Believed("latent", None, known=True),
            [("whole", "scene"), ("sketch", "scene"), "settle from scene"]
            + [("relit", "latent"), ("again", "latent"), "follow"],
        ),
        (
            Believed("latent", None, terms=Terms(thorough=False)),
            [("whole", "none"), ("sketch", "none"), ("light", "latent"), "follow"],
        ),
    ],
)
def test_what_is_hidden_from_a_tile_is_asked_once_maps_are_worth_it(monkeypatch, world, asked):
    """It takes longer than all else, and follows maps."""
    done = []

    @dataclass(frozen=True)
    class Told:
        problem: str

    def solve(problem, fitted, purpose, progress):
        done.append((purpose, problem))
        return Told(problem)

    def settle(world, light, fitted, *_):
        done.append(f"settle from {light}")
        return world, fitted, {}

    monkeypatch.setattr(story, "settle", settle)
    monkeypatch.setattr(story, "follow", lambda world, fitted, *_: done.append("follow") or fitted)
    monkeypatch.setattr(story, "with_model_error", lambda world, fitted, *_: (fitted,))
    assert story.retell(solve, world, None).problem == world.shadows
    assert done == asked


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
    fast = evsdr.Settings(preset="fast", shared=())
    said = []
    found = evsdr.fit(ring, recording, fast, progress=lambda stage, share: said.append(stage))
    assert any(stage.startswith("tiles, 2 of ") for stage in said)
    monkeypatch.setattr(tiling, "AT_ONCE", 10**6)
    whole = evsdr.fit(ring, recording, fast)
    assert "tiles" in found.summary["seconds"] and "tiles" not in whole.summary["seconds"]
    for name in ("events", "pairs", "pixels_solved"):
        assert found.summary["numbers"][name] == whole.summary["numbers"][name]
    assert len(found.solution.theta) == whole.summary["numbers"]["pixels_solved"]
    both = found.maps.mask & whole.maps.mask
    assert both.sum() > 0.95 * whole.maps.mask.sum()
    apart = angular_error_deg(found.maps.normal, whole.maps.normal)[both]
    assert np.median(apart) < np.median(whole.maps.normal_sigma_deg[both])


def test_tiles_are_judged_by_pixels_whose_events_are_there(small, place, monkeypatch):
    """Tiles keep no pairs: how far residuals still move, of photoreceptors that lag, is that of the pixels that told them."""
    ring, counts = evsdr.load_scene(place / "scene.xml"), []

    def moves(world, fitted):
        counts.append((len(fitted.problem.pairs.counts), fitted.problem.n_pixel))
        return 0.4

    monkeypatch.setattr(story, "moves", moves)
    monkeypatch.setattr(tiles, "ENOUGH", 50)
    recording, _ = evsdr.simulate(ring, seed=1, thresholds="nominal")
    with pytest.warns(evsdr.InputWarning, match="residuals by 0.4 of"):
        found = evsdr.fit(ring, recording, evsdr.Settings(preset="fast", shared=()))
    ((with_pairs, fitted),) = counts
    assert with_pairs == fitted and 0 < fitted < len(found.solution.theta)
