"""What fits cost is read from fits, and only those that no other beats are drawn as best."""

import pytest

from evsdr.fitting.budget import COST, Cost
from experiments.speed_accuracy.__main__ import costs
from experiments.speed_accuracy.compute import PRESETS, Result, slopes
from experiments.speed_accuracy.draw import draw, front, together


def result(way, pixels, events, seconds):
    errors = {"mae_deg": 0.1 + 1 / seconds, "sam_deg": 1.0, "rmse": 0.1}
    return Result(way, 64, 6, 0, pixels, events, seconds, 400.0, 0.05, errors)


def test_slopes_are_found():
    sizes = [(1000, 50_000), (4000, 150_000), (16_000, 900_000), (60_000, 2_000_000)]
    for preset, cost in COST.items():
        found = slopes([result(preset, *size, cost.seconds(*size)) for size in sizes])
        assert found[preset] == pytest.approx((cost.start, cost.pixel, cost.event), rel=1e-6)
    assert set(COST) == set(PRESETS)
    assert slopes([result("fast", *sizes[0], 1.0)]) == {}


def test_costs_are_written_as_the_budget_reads_them():
    results = [
        result(way, n, 90 * n, 4 + n / 1000) for way in ("fast", "balanced") for n in (1000, 3000, 9000)
    ]
    found = {}
    exec(costs(results), {"Cost": Cost}, found)
    assert found["REFERENCE"] == 0.05 and list(found["COST"]) == ["balanced", "fast"]
    assert found["COST"]["fast"].seconds(3000, 270_000) == pytest.approx(5.0, rel=0.02)


def test_the_front_holds_what_no_other_beats(tmp_path):
    assert front([(3, 1), (1, 5), (2, 6), (2, 2), (4, 1)]) == [(1, 5), (2, 2), (3, 1)]
    draw(tmp_path / "a.png", [result("fast", 1, 1, 1.0), result("balanced", 1, 1, 3.0)])
    assert (tmp_path / "a.png").stat().st_size > 1000


def test_points_that_lie_together_share_a_label():
    assert together([(1, 1), (1.01, 1), (10, 1), (1, 0.1), (10, 0.99)]) == [[0, 1], [2, 4], [3]]
