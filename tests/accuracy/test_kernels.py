"""A fit of another recording of a scene compiles nothing: what is learnt reaches kernels as arrays."""

import warnings

import drjit as dr
import pytest

import evsdr
from tests.conftest import REPOSITORY

SCENES = REPOSITORY / "scenes"
SIZE = 16


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scene", "fitted", "preset"),
    [
        ("glossy_sphere", "glossy_sphere", "fast"),
        ("relief", "relief_unknown", "fast"),
    ],
)
def test_another_recording_adds_no_kernel(scene, fitted, preset):
    """With lag, unknown thresholds, gloss, and for a relief shadows on the estimated depth, of as many rays.

    What neighbours tell is in `tests/experiments/test_kernels.py`.
    """
    ring = evsdr.load_scene(SCENES / f"{scene}.xml", size=SIZE)
    surface = evsdr.load_scene(SCENES / f"{fitted}.xml", size=SIZE)
    seeds, compiled = iter(range(5)), []

    def note(*_):
        """Ask often, as each launch is kept with its code until then."""
        kernels = [kernel for kernel in dr.kernel_history() if "hash" in kernel]
        compiled.extend(not kernel["cache_hit"] and not kernel.get("cache_disk") for kernel in kernels)

    def fit(progress=None):
        recording, _ = evsdr.simulate(ring, seed=next(seeds), thresholds="nominal", rounds=4)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", evsdr.InputWarning)
            evsdr.fit(surface, recording, evsdr.Settings(preset=preset), progress=progress)

    fit()
    fit()  # what only some recordings ask for
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history()
        fit(note)
        note()
    assert len(compiled) > 500
    assert not any(compiled)
