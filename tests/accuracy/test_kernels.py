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
    ("scene", "fitted", "leds"),
    [
        ("glossy_sphere", "glossy_sphere", "ring24"),
        ("near_ring", "relief_unknown", "ring24_near"),
    ],
)
def test_another_recording_adds_no_kernel(scene, fitted, leds, tmp_path):
    """With lag, unknown thresholds, gloss, and shadows and near LEDs on the estimated depth, of as many rays.

    What neighbours tell is in `tests/experiments/test_kernels.py`.
    """
    ring = evsdr.load_scene(SCENES / f"{scene}.xml", size=SIZE)
    text, told = (SCENES / f"{fitted}.xml").read_text(), tmp_path / "told.xml"
    told.write_text(text.replace("ring24", leds).replace('filename="', f'filename="{SCENES}/'))
    surface = evsdr.load_scene(told, size=SIZE)
    seeds, compiled = iter((0, 2, 1)), []

    def note(*_):
        """Ask often, as each launch is kept with its code until then."""
        kernels = [kernel for kernel in dr.kernel_history() if "hash" in kernel]
        compiled.extend(not kernel["cache_hit"] and not kernel.get("cache_disk") for kernel in kernels)

    def fit(progress=None):
        recording, _ = evsdr.simulate(ring, seed=next(seeds), thresholds="nominal", rounds=4)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", evsdr.InputWarning)
            evsdr.fit(surface, recording, evsdr.Settings(preset="fast"), progress=progress)

    for _ in range(2):
        fit()  # the first need not take every way
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history()
        fit(note)
        note()
    assert len(compiled) > 500
    assert not any(compiled)
