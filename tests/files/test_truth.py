"""truth.npz: read as it is, or refused in one sentence."""

import numpy as np
import pytest

from evsdr.errors import InputError
from evsdr.files.truth import read_truth

HEIGHT, WIDTH, N_BAND = 3, 4, 2


@pytest.fixture
def arrays(rng):
    normal = rng.normal(size=(HEIGHT, WIDTH, 3)) + [0, 0, 4]
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    mask = np.ones((HEIGHT, WIDTH), bool)
    mask[0, 0] = False
    return {"normal": normal, "reflectance": rng.random((HEIGHT, WIDTH, N_BAND)), "mask": mask}


def read(tmp_path, arrays):
    np.savez(tmp_path / "truth.npz", **arrays)
    return read_truth(tmp_path / "truth.npz", HEIGHT, WIDTH, N_BAND)


def test_a_truth_is_read_as_it_is(tmp_path, arrays):
    arrays["normal"][0, 0] = np.nan  # outside the mask anything may stand
    truth = read(tmp_path, arrays | {"mask": 2 * arrays["mask"].astype(np.uint8), "more": np.ones(1)})
    for name, array in arrays.items():
        np.testing.assert_array_equal(getattr(truth, name), array)
    assert truth.mask.dtype == bool


def spoilt(name, place, value):
    """Change an array at a place."""

    def spoil(arrays):
        arrays[name] = arrays[name].copy()
        arrays[name][place] = value
        return arrays

    return spoil


@pytest.mark.parametrize(
    "spoil, sentence",
    [
        (lambda a: {k: v for k, v in a.items() if k != "mask"}, "the array mask is missing"),
        (lambda a: a | {"normal": a["normal"][:2]}, r"normal is an array of float64 with shape \(2, 4, 3\)"),
        (
            lambda a: a | {"reflectance": a["reflectance"][..., :1]},
            r"shape \(3, 4, 1\); store .* \(3, 4, 2\)",
        ),
        (lambda a: a | {"reflectance": a["reflectance"].astype(str)}, "reflectance is an array of <U"),
        (lambda a: a | {"mask": 0 * a["mask"]}, "mask selects no pixel"),
        (spoilt("reflectance", (1, 1, 0), np.inf), "reflectance is not finite at some pixel of the mask"),
        (spoilt("normal", (1, 1), [0, 0, 1.02]), "normal has not unit length"),
        (lambda a: a | {"normal": a["normal"] * [1, 1, -1]}, "normal points away from the camera"),
    ],
)
def test_a_bad_truth_is_refused(tmp_path, arrays, spoil, sentence):
    with pytest.raises(InputError, match=rf"truth\.npz: .*{sentence}.*\.$"):
        read(tmp_path, spoil(arrays))


def test_a_missing_or_damaged_file_is_refused(tmp_path, arrays):
    with pytest.raises(InputError, match="there is no such file"):
        read_truth(tmp_path / "truth.npz", HEIGHT, WIDTH, N_BAND)
    read(tmp_path, arrays)
    whole = (tmp_path / "truth.npz").read_bytes()
    for damaged in (whole[: len(whole) // 2], b"no archive"):
        (tmp_path / "truth.npz").write_bytes(damaged)
        with pytest.raises(InputError, match="not a readable .npz archive"):
            read_truth(tmp_path / "truth.npz", HEIGHT, WIDTH, N_BAND)
