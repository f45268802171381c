"""The count of kernels: what a fit compiles is kept in its home folder, and another recording needs no more."""

import pytest

from experiments.kernels.compute import CACHE, count_kernels, fit_in_turn


def test_only_kernels_are_counted(tmp_path):
    assert count_kernels(tmp_path) == 0
    (tmp_path / CACHE).mkdir()
    for name in ("a.llvm.v6.bin", "b.llvm.v6.bin", "b.llvm.v6.bin.tmp"):
        (tmp_path / CACHE / name).touch()
    assert count_kernels(tmp_path) == 2


@pytest.mark.slow
def test_the_first_fit_compiles_and_the_second_does_not():
    first, second = fit_in_turn("sphere", 24)
    assert first.kernels > 50 and first.seconds > second.seconds
    assert second.kernels == 0
