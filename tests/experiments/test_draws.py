"""Draws at random: the same seed draws the same, and a fit is told what it should be told."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.draws.__main__ import FRAMES, foreign_pixel, line, main, otherwise, record
from experiments.draws.cases import MATERIALS, SHAPES, draw
from experiments.sigma.compute import Errors

SIZE = 8


def test_a_seed_draws_the_same():
    assert draw(3) == draw(3) != draw(4)
    assert len({draw(seed).pixel for seed in range(60)}) == 6


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("leds", ["far", "near", "soft"])
def test_a_fit_is_told_the_shape_only_where_it_is_known(known, leds):
    case = replace(
        draw(0), shape="blob", leds=leds, known=known, pixel="evk4", power=0.1, told_threshold=1.15
    )
    told, recording, truth = record(replace(case, rounds=1), SIZE)
    assert told.shape_is_known == known and told.is_near == (leds != "far") and truth.mask.any()
    assert recording.sensor.contrast_threshold_on == pytest.approx(1.15 * case.on, rel=0.01)
    powers = case.log_power.reshape(3, 8)
    np.testing.assert_allclose(powers.sum(axis=0), 0, atol=1e-12)
    assert powers.std() > 0.05


@pytest.mark.parametrize("shape", [s for s in SHAPES if s in ("sphere", "cylinder", "plane", "relief")])
@pytest.mark.parametrize("material", MATERIALS)
def test_all_scenes_can_be_recorded(shape, material):
    case = replace(
        draw(1), shape=shape, material=material, leds="far", pixel="evk4_like", rounds=1, slot_us=2000.0
    )
    told, recording, truth = record(replace(case, pauses=True), SIZE)
    assert truth.mask.any() and len(recording.schedule.order) == 32
    assert told.constant_light == pytest.approx(case.constant_light + 0.002, rel=1e-3)  # its dark current


@pytest.mark.parametrize("crossfade", [0.0, 0.3, 1.0])
def test_frames_are_many_in_a_fade(crossfade):
    """Light is linear in log I from one to the next: of few in a fade, events come at times of another light."""
    case = replace(draw(0), crossfade=crossfade, slot_us=6000.0)
    fade = 6000.0 * (crossfade or 1)
    for pixel in ("esim", "eventps"):
        assert foreign_pixel(replace(case, pixel=pixel)).frame_us <= fade / FRAMES * 1.001
        assert foreign_pixel(replace(case, pixel=pixel, slot_us=1e6, crossfade=1.0)).frame_us == 500
    assert (
        foreign_pixel(replace(case, pixel="iebcs")).frame_us == 0
        and foreign_pixel(replace(case, pixel="evk4")) is None
    )


def test_parts_may_be_otherwise_than_drawn(capsys):
    case = otherwise(draw(0), ["shape=sphere", "pauses=True", "slot_us=5000", "rounds=2"])
    assert case == replace(draw(0), shape="sphere", pauses=True, slot_us=5000, rounds=2)
    for change in ("form=sphere", "rounds=two", "rounds=2.5", "pauses=x(", "shape", "__str__=a"):
        with pytest.raises(SystemExit) as ended:
            main(["--but", change])
        assert ended.value.code == 2 and f"{change!r} is no NAME=VALUE" in capsys.readouterr().err


def test_a_row_says_what_was_drawn_and_kept():
    errors = Errors(
        0.9, 1.25, 1.0, 0.1, np.full(10, 0.5), np.full((10, 2), -2.5), np.zeros(0), np.zeros(0), "trustworthy"
    )
    row = line(replace(draw(2), seed=17), errors, [True, False], 12.3)
    assert (
        row.startswith("| 17: ") and "| 90%, 1.25, 100 100 100 | 0 0 100 | yes no | 12 | trustworthy |" in row
    )
