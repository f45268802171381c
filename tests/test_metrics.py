"""Angles, spectral angles and errors against values known in closed form."""

import numpy as np
import pytest

from evsdr.errors import InputError
from evsdr.files.truth import read_truth
from evsdr.metrics import angular_error_deg, score
from evsdr.records import Truth

HEIGHT, WIDTH, N_BAND = 4, 5, 3


@pytest.mark.parametrize("degrees", [0.0, 1e-7, 1e-3, 30.0, 90.0, 150.0, 179.999999, 180.0])
def test_angle_is_accurate_everywhere(degrees):
    """Relative accuracy of 1e-8 where arccos of the dot product has none."""
    angle = np.radians(degrees)
    found = angular_error_deg([np.cos(angle), np.sin(angle), 0.0], [2.0, 0.0, 0.0])
    assert found == pytest.approx(degrees, rel=1e-8, abs=1e-13)


def test_angle_of_zero_vectors():
    found = angular_error_deg([[0, 0], [1, 0], [0, 0]], [[0, 0], [0, 0], [0, 3]])
    np.testing.assert_allclose(found, [0, 90, 90], rtol=1e-15)


def tilted(degrees):
    angle = np.radians(degrees)
    return np.stack([np.sin(angle), np.zeros_like(angle), np.cos(angle)], axis=-1)


def test_score_by_hand():
    """Pixel errors 1, 2, 6 degrees; a fourth pixel lies outside the mask."""
    mask = np.array([[True, True, True, False]])
    truth = Truth(tilted(np.zeros((1, 4))), np.array([[[0.5, 0.5], [0.4, 0.0], [0, 0], [1, 1.0]]]), mask)
    reflectance = np.array([[[0.8, 0.1], [0.0, 0.4], [0, 0], [0, 0.0]]])
    found = Truth(tilted(np.array([[1.0, 2.0, 6.0, 80.0]])), reflectance, mask)
    result = score(found, truth)
    assert result["mae_deg"] == pytest.approx(3.0)
    assert result["median_deg"] == pytest.approx(2.0)
    sam = 45 - np.degrees(np.arctan(0.1 / 0.8))  # then 90, one of two being across, and 0 for two zeros
    assert result["sam_deg"] == pytest.approx((sam + 90 + 0) / 3)
    assert result["rmse"] == pytest.approx((np.sqrt((0.09 + 0.16) / 2) + 0.4 + 0) / 3)
    assert all(type(value) is float for value in result.values())


def test_score_does_not_rescale():
    reflectance = np.full((2, 2, 3), 0.5, np.float32)
    truth = Truth(tilted(np.zeros((2, 2))), reflectance, np.ones((2, 2), bool))
    doubled = Truth(truth.normal, 2 * reflectance, truth.mask)
    result = score(doubled, truth)
    assert (result["rmse"], result["sam_deg"]) == pytest.approx((0.5, 0.0), abs=1e-9)


@pytest.fixture
def arrays():
    rng = np.random.default_rng(1)
    mask = np.ones((HEIGHT, WIDTH), bool)
    mask[0, 0] = False
    normal = tilted(rng.uniform(0, 60, (HEIGHT, WIDTH))).astype(np.float32)
    normal[0, 0] = np.nan  # allowed: outside the mask
    return {"normal": normal, "reflectance": rng.random((HEIGHT, WIDTH, N_BAND)), "mask": mask}


def test_truth_is_read(tmp_path, arrays):
    np.savez(tmp_path / "truth.npz", **arrays | {"mask": arrays["mask"].astype(np.uint8), "extra": 1})
    truth = read_truth(tmp_path / "truth.npz", HEIGHT, WIDTH, N_BAND)
    for name, array in arrays.items():
        np.testing.assert_array_equal(getattr(truth, name), array)
    assert truth.mask.dtype == bool


@pytest.mark.parametrize(
    "change, sentence",
    [
        (lambda a: a.pop("mask"), "the array mask is missing"),
        (lambda a: a.update(normal=a["normal"][1:]), "normal is an array of float32 with shape"),
        (lambda a: a.update(reflectance=a["reflectance"][..., 1:]), "reflectance is an array of float64"),
        (lambda a: a.update(mask=np.full((HEIGHT, WIDTH), "yes")), "mask is an array of <U3"),
        (lambda a: a.update(mask=0 * a["mask"]), "mask selects no pixel"),
        (lambda a: a["reflectance"].__setitem__((1, 1, 1), np.inf), "reflectance is not finite"),
        (lambda a: a.update(normal=1.1 * a["normal"]), "normal has not unit length"),
        (lambda a: a.update(normal=-a["normal"]), "normal points away from the camera"),
        (lambda a: a.update(mask=np.array([[object()]])), "not a readable .npz"),
    ],
)
def test_faults_of_truth(tmp_path, arrays, change, sentence):
    change(arrays)
    path = tmp_path / "truth.npz"
    np.savez(path, **arrays)
    with pytest.raises(InputError, match=sentence) as caught:
        read_truth(path, HEIGHT, WIDTH, N_BAND)
    assert str(caught.value).startswith(f"{path}: ")


def test_truth_file_faults(tmp_path, arrays):
    path = tmp_path / "truth.npz"
    with pytest.raises(InputError, match="no such file"):
        read_truth(path, HEIGHT, WIDTH, N_BAND)
    np.savez(path, **arrays)
    whole = path.read_bytes()
    np.save(tmp_path / "one.npy", arrays["mask"])
    for data in (b"", b"not an archive", whole[: len(whole) // 2], (tmp_path / "one.npy").read_bytes()):
        path.write_bytes(data)
        with pytest.raises(InputError, match=r"not a readable \.npz"):
            read_truth(path, HEIGHT, WIDTH, N_BAND)


def test_unknown_reflectance_is_not_scored():
    """Photographs come with true normals only; their reflectance is stored as 0."""
    normal, mask = np.tile([0.0, 0.0, 1.0], (HEIGHT, WIDTH, 1)), np.ones((HEIGHT, WIDTH), bool)
    estimate = Truth(normal, np.full((HEIGHT, WIDTH, N_BAND), 0.5), mask)
    truth = Truth(normal, np.zeros((HEIGHT, WIDTH, N_BAND)), mask)
    assert set(score(estimate, truth)) == {"mae_deg", "median_deg"}
