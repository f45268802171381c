"""What is handed on: bands in order, lengths in millimetres, sentences for what can't be."""

import json
import shutil

import numpy as np
import pytest

from evsdr.errors import InputError
from evsdr.exports.source import library, read_source
from evsdr.files.results import write_results
from tests.support.page_fits import make_fit


def test_bands_are_sorted_and_all_else_is_as_fitted(results, fit):
    source = read_source(results)
    order = [1, 2, 0]  # 405, 530, 620
    np.testing.assert_array_equal(source.maps.band_wavelength_nm, fit.maps.band_wavelength_nm[order])
    for name in ("reflectance", "reflectance_sigma"):
        np.testing.assert_array_equal(getattr(source.maps, name), getattr(fit.maps, name)[..., order])
    np.testing.assert_array_equal(source.maps.normal, fit.maps.normal)


@pytest.mark.parametrize(
    ("told", "factor", "unit"), [(None, 10, "mm"), ("mm", 1, "mm"), ("um", 1e-3, "mm"), ("m", 1e3, "mm")]
)
def test_lengths_are_millimetres(results, fit, told, factor, unit):
    source = read_source(results, told)
    mask = fit.maps.mask
    np.testing.assert_allclose(source.points[mask], factor * fit.depth.points[mask], rtol=1e-6)
    assert not source.points[~mask].any()
    assert source.unit == unit and source.pixel_mm == pytest.approx(factor * fit.depth.camera.pixel_size[0])


def test_triangles_join_neighbours(results, fit):
    source = read_source(results)
    corner = np.argwhere(fit.maps.mask)[source.face]
    assert len(corner) and np.ptp(corner, axis=1).max() == 1


def changed(results, folder, **entries):
    """Copy results with other entries in the summary; those that are None go."""
    shutil.copytree(results, folder)
    summary = json.loads((folder / "summary.json").read_text()) | entries
    summary = {name: value for name, value in summary.items() if value is not None or name == "unit"}
    (folder / "summary.json").write_text(json.dumps(summary))
    return folder


def test_without_a_unit_lengths_stay(results, fit, tmp_path):
    source = read_source(changed(results, tmp_path / "fit", unit=None))
    np.testing.assert_allclose(source.points[fit.maps.mask], fit.depth.points[fit.maps.mask], rtol=1e-6)
    assert source.unit == "scene" and source.pixel_mm is None


NOWHERE = {"perspective": False, "pixel_size": [float("nan"), 1], "center": [0, 0]}


@pytest.mark.parametrize("camera", [None, {}, {"pixel_size": [1]}, NOWHERE, 3])
def test_results_of_an_older_evsdr_are_refused(results, tmp_path, camera):
    with pytest.raises(InputError, match="no surface with its camera"):
        read_source(changed(results, tmp_path / "fit", camera=camera))


def test_a_spoiled_file_is_refused(results, tmp_path):
    folder = changed(results, tmp_path / "fit")
    (folder / "depth.exr").write_bytes(b"no")
    with pytest.raises(InputError, match="depth.exr: this is not the file"):
        read_source(folder)


def test_results_without_a_known_pixel_are_refused(tmp_path):
    fit = make_fit()
    fit.maps.mask[:] = False
    write_results(tmp_path, fit.maps, fit.summary)
    with pytest.raises(InputError, match="no pixel is known"):
        read_source(tmp_path)


def test_a_library_that_is_missing_is_named():
    with pytest.raises(InputError, match=r"no_such_library is not installed; .*evsdr\[export\]"):
        library("no_such_library.io")
