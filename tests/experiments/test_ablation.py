"""The ablation: every way is another solve, and its table holds all of them."""

from dataclasses import replace

from experiments.ablation.__main__ import table
from experiments.ablation.compute import CASES, WAYS, Result, record, varied


def test_every_way_is_another_solve():
    settings = list(WAYS.values())
    assert all(a != b for i, a in enumerate(settings) for b in settings[i + 1 :])
    assert len({case.name for case in CASES}) == len(CASES)


def test_each_number_is_halved_and_doubled():
    ways = varied()
    tuning = ways.pop("all").tuning
    assert ways[f"misfit {tuning.misfit / 2:g}"].tuning.misfit == 0.5 * tuning.misfit
    assert ways[f"misfit {2 * tuning.misfit:g}"].tuning == replace(tuning, misfit=2 * tuning.misfit)
    assert all(isinstance(way.tuning.n_sweep, int) for way in ways.values())
    assert len({way.tuning for way in ways.values()}) == len(ways) and len(ways) % 2 == 0


def test_the_chart_is_recorded_with_dark_slots():
    (case,) = [case for case in CASES if case.name == "chart"]
    _, recording, truth = record(case.__class__(case.name, case.scene, 12, order=case.order), 0)
    assert (recording.schedule.order == -1).sum() == 8
    assert truth.mask.any()


def test_ratios_are_of_the_same_recording():
    found = {(way, "a"): [Result(2.0, 0.02, 1.0), Result(4.0, 0.02, 1.0)] for way in WAYS}
    found["no priors", "a"] = [Result(4.0, 0.02, 1.0), Result(4.0, 0.02, 1.0)]
    found["scatter", "a"] = found["all", "a"]
    out = table("mean angle", "mae_deg", WAYS, ["a"], found)
    column = list(out.columns[1].cells)
    assert column[:2] == ["3", "47.1 %"] and column[-1] == "1.500"
