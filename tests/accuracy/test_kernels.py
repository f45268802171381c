"""A fit of another recording of a scene compiles nothing: what is learnt reaches kernels as arrays."""

import warnings

import drjit as dr
import pytest

import evsdr
from tests.conftest import REPOSITORY

SCENES = REPOSITORY / "scenes"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scene", "fitted", "preset"),
    [
        ("sphere", "sphere", "balanced"),
        ("glossy_sphere", "glossy_sphere", "balanced"),
        ("relief", "relief_unknown", "fast"),
    ],
)
def test_another_recording_adds_no_kernel(scene, fitted, preset):
    """With lag, unknown thresholds, priors, and for a relief shadows on the estimated depth, of as many rays."""
    ring = evsdr.load_scene(SCENES / f"{scene}.xml", size=24)
    surface = evsdr.load_scene(SCENES / f"{fitted}.xml", size=24)
    seeds = iter(range(5))

    def fit():
        recording, _ = evsdr.simulate(ring, seed=next(seeds), thresholds="nominal", rounds=4)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", evsdr.InputWarning)
            evsdr.fit(surface, recording, evsdr.Settings(preset=preset))

    fit()
    fit()  # what only some recordings ask for
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history()
        fit()
        kernels = [kernel for kernel in dr.kernel_history() if "hash" in kernel]
    compiled = [k for k in kernels if not k["cache_hit"] and not k.get("cache_disk")]
    assert len(kernels) > 500
    assert len(compiled) == 0
