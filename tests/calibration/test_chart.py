"""Spectra, their projection on bands, and the patches of a chart."""

from pathlib import Path

import numpy as np
import pytest

from evsdr.calibration.chart import (
    PatchSpectra,
    PatchTable,
    chart_labels,
    choose,
    over_white,
    project,
    read_patches,
    read_spectra,
    write_patches,
)
from evsdr.errors import InputError, InputWarning
from evsdr.model.quadrature import WAVELENGTH_NM

SCENES = Path(__file__).resolve().parents[2] / "scenes"


BANDS = np.exp(-0.5 * ((WAVELENGTH_NM - np.array([[450.0], [550.0], [650.0]])) / 12) ** 2)


def test_projection_of_a_line_and_of_noise(rng):
    """A line is projected on the band's centroid; sigma is the scatter over noisy copies."""
    nm = np.arange(380.0, 731.0, 5.0)
    line = (nm - 300) / 1000
    table = project(PatchSpectra(["line"], nm, line[None]), BANDS)
    np.testing.assert_allclose(table.band_nm, [450, 550, 650], atol=1e-6)
    np.testing.assert_allclose(table.value[0], [0.15, 0.25, 0.35], atol=1e-6)
    noisy = line + rng.normal(0, 0.01, (300, len(nm)))
    table = project(PatchSpectra([str(k) for k in range(300)], nm, noisy), BANDS)
    np.testing.assert_allclose(table.value.std(axis=0), np.median(table.sigma, axis=0), rtol=0.15)


def test_white_patch_divides_out_the_light(tmp_path):
    nm = np.arange(400.0, 701.0, 10.0)
    light = 3 + np.sin(nm / 50)
    (tmp_path / "s.csv").write_text(
        "wavelength_nm,a,white\n" + "".join(f"{w},{0.3 * i},{0.9 * i}\n" for w, i in zip(nm, light))
    )
    found = over_white(read_spectra(str(tmp_path / "s.csv")), "white", 0.9)
    assert found.name == ["a"]
    np.testing.assert_allclose(found.value, 0.3, atol=1e-12)
    with pytest.raises(InputError, match="no column has that name; there are a, white"):
        over_white(read_spectra(str(tmp_path / "s.csv")), "grey", 1.0)


@pytest.mark.parametrize(
    "text, says",
    [
        ("a,b\n0.1,0.2\n0.1,0.2\n0.1,0.2\n0.1,0.2\n", "first column is named 'a', not wavelength_nm"),
        ("wavelength_nm,b\n400,1\n390,1\n410,1\n420,1\n", "must grow line by line"),
        ("wavelength_nm,b\n400,1\n410,x\n", "not a readable table"),
        ("wavelength_nm,b\n400,1\n410\n", "not a readable table"),
        ("wavelength_nm,b\n400,1\n410,nan\n420,1\n430,1\n", "no finite numbers"),
        ("", "not a readable table"),
    ],
)
def test_spectra_that_can_not_be_used_are_refused(tmp_path, text, says):
    (tmp_path / "s.csv").write_text(text)
    with pytest.raises(InputError, match=says):
        read_spectra(str(tmp_path / "s.csv"))


def test_bands_beyond_the_spectra(tmp_path):
    nm = np.arange(400.0, 651.0, 10.0)
    with pytest.raises(InputError, match="band at 650 nm lies outside of the measured 400 to 650"):
        project(PatchSpectra(["a"], nm, np.full((1, len(nm)), 0.5)), BANDS)
    nm = np.arange(400.0, 681.0, 10.0)
    with pytest.warns(InputWarning, match="taken as constant"):
        project(PatchSpectra(["a"], nm, np.full((1, len(nm)), 0.5)), BANDS)
    with pytest.raises(InputError, match="give shares of 1"):
        project(PatchSpectra(["a"], nm, np.full((1, len(nm)), 50.0)), BANDS)


def test_tables_survive_the_file(tmp_path, rng):
    value = rng.random((2, 3))
    table = PatchTable(
        ["red, dark", "b"], np.array([3, 7]), np.array([450.0, 550.0, 650.0]), value, 0.01 * value
    )
    write_patches(tmp_path / "t.csv", table)
    back = read_patches(tmp_path / "t.csv")
    assert back.name == table.name
    np.testing.assert_array_equal(back.number, table.number)
    np.testing.assert_allclose(back.value, value, atol=1e-6)
    np.testing.assert_allclose(back.sigma, 0.01 * value, rtol=0.1)
    assert choose(back, ["7"]).name == ["b"]
    with pytest.raises(InputError, match="no patch is called c"):
        choose(back, ["c"])


def test_chart_labels_of_a_tilted_chart():
    """A chart of 2 x 3 patches seen from aside: labels lie in their own patch."""
    corner = np.array([(10.0, 12.0), (80.0, 20.0), (70.0, 75.0), (15.0, 60.0)])
    label = chart_labels(corner, (90, 100), n_row=2, n_column=3)
    assert set(np.unique(label)) == set(range(7))
    row, column = np.indices(label.shape)
    centre = [(column[label == k].mean(), row[label == k].mean()) for k in range(1, 7)]
    assert np.linalg.norm(centre[0] - corner[0]) < 25 and np.linalg.norm(centre[2] - corner[1]) < 25
    assert np.linalg.norm(centre[5] - corner[2]) < 25 and np.linalg.norm(centre[3] - corner[3]) < 25
    with pytest.raises(InputError, match="not the corners of a chart"):
        chart_labels(corner[[0, 2, 1, 3]], (90, 100))
