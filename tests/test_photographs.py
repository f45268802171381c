"""Stacks of photographs: what can't be used, and the way from photographs to maps."""

import json

import numpy as np
import pytest
from analytic import ring_directions, sphere_normals

from evsdr import fit, simulate
from evsdr.errors import InputError
from evsdr.photographs import read_stack

N_LED, SIZE = 12, 24


@pytest.fixture
def stack():
    """Photographs of a white-ish sphere, one band."""
    normal, mask = sphere_normals(SIZE)
    direction = ring_directions(N_LED)
    frames = 0.6 * np.maximum(np.einsum("hwk,jk->jhw", normal, direction), 0) * mask
    truth = {"normal": np.where(mask[..., None], normal, [0, 0, 1]), "mask": mask}
    return {
        "frames": frames,
        "light_direction": direction,
        "reflectance": np.full((SIZE, SIZE, 1), 0.6),
    } | truth


def test_photographs_become_maps(stack, tmp_path):
    np.savez(tmp_path / "stack.npz", **stack)
    argv = [
        "--frames",
        str(tmp_path / "stack.npz"),
        "--out",
        str(tmp_path),
        "--ideal",
        "--pixel.event-noise",
        "0.05",
    ]
    assert simulate.main([*argv, "--order", *(str(s) for j in range(N_LED) for s in (-1, j))]) == 0
    files = [str(tmp_path / name) for name in ("scene.xml", "events.h5", "truth.npz")]
    np.save(tmp_path / "mask.npy", stack["mask"])
    options = ["--truth", files[2], "--out", str(tmp_path / "fit"), "--mask", str(tmp_path / "mask.npy")]
    assert fit.main([*files[:2], *options]) == 0
    summary = json.loads((tmp_path / "fit" / "summary.json").read_text())
    assert summary["median_deg"] < 1.0
    assert summary["rmse"] < 0.03


@pytest.mark.parametrize(
    ("change", "names"),
    [
        ({"frames": None}, "frames"),
        ({"light_direction": None}, "light_direction"),
        ({"frames": np.ones((N_LED, SIZE))}, "frames"),
        ({"light_direction": np.ones((3, 3))}, "light_direction"),
        ({"light_direction": np.zeros((N_LED, 3))}, "light_direction"),
        ({"frames": -np.ones((N_LED, SIZE, SIZE))}, "frames"),
        ({"frames": np.full((N_LED, SIZE, SIZE), np.nan)}, "frames"),
        ({"mask": np.ones((3, 4), bool)}, "mask"),
    ],
)
def test_a_stack_that_cannot_be_used_says_why(stack, tmp_path, change, names):
    arrays = {name: value for name, value in (stack | change).items() if value is not None}
    np.savez(tmp_path / "stack.npz", **arrays)
    with pytest.raises(InputError, match=rf"stack\.npz.*{names}"):
        read_stack(tmp_path / "stack.npz")


def test_a_file_that_is_no_stack_says_so(tmp_path):
    with pytest.raises(InputError, match="stack"):
        read_stack(tmp_path / "stack.npz")
    (tmp_path / "stack.npz").write_bytes(b"no archive")
    with pytest.raises(InputError, match="archive"):
        read_stack(tmp_path / "stack.npz")
