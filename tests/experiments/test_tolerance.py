"""Fits to several tolerances: of the same recordings, with more steps the smaller it is."""

from experiments.tolerance.__main__ import table
from experiments.tolerance.compute import Result, run


def test_a_smaller_tolerance_takes_more_steps():
    found = run("sphere", 12, range(1, 2), (30.0, 0.1))
    coarse, fine = (found[tolerance] for tolerance in (30.0, 0.1))
    assert len(coarse) == len(fine) == 1
    assert coarse[0].n_step < fine[0].n_step


def test_rows_are_means():
    found = {0.1: [Result(1.0, 0.02, 10, "settled", 1.0), Result(2.0, 0.04, 20, "steps used up", 3.0)]}
    (row,) = zip(*(column.cells for column in table("a", found).columns))
    assert row == ("0.1", "1.500", "0.707", "0.0300", "15", "1 of 2", "2.00")
