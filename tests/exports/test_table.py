"""The CSV, opened by the csv module."""

import csv

import numpy as np

from evsdr.exports.source import read_source
from evsdr.exports.table import write_csv


def test_every_known_pixel_has_its_line(results, fit, tmp_path):
    write_csv(tmp_path, read_source(results))
    with open(tmp_path / "pixels.csv", newline="") as file:
        lines = list(csv.DictReader(file))
    mask, order = fit.maps.mask, [1, 2, 0]

    def column(*names):
        return np.array([[float(line[name]) for name in names] for line in lines])

    np.testing.assert_array_equal(column("row", "column"), np.argwhere(mask))
    np.testing.assert_allclose(column("x_mm", "y_mm", "z_mm"), 10 * fit.depth.points[mask], rtol=1e-6)
    close = {"rtol": 1e-6, "atol": 1e-7}
    np.testing.assert_allclose(column("normal_x", "normal_y", "normal_z"), fit.maps.normal[mask], **close)
    np.testing.assert_allclose(column("normal_sigma_deg")[:, 0], fit.maps.normal_sigma_deg[mask], **close)
    for word, values in (("reflectance", fit.maps.reflectance), ("sigma", fit.maps.reflectance_sigma)):
        found = column(*(f"{word}_{b}_{nm}nm" for b, nm in enumerate((405, 530, 620))))
        np.testing.assert_allclose(found, values[mask][:, order], **close)
    np.testing.assert_array_equal(column("scale_known")[:, 0], fit.maps.mask_reflectance[mask])
