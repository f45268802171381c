"""Float TIFFs, opened by GDAL."""

import json

import numpy as np
import pytest
import rasterio

from evsdr.exports.source import read_source
from evsdr.exports.tiff import write_tiff

# Pictures of a camera lie nowhere on the Earth.
pytestmark = pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")

NAMES = ("normal", "depth", "normal_sigma_deg", "reflectance", "reflectance_sigma")


@pytest.mark.parametrize("name", NAMES)
def test_map_is_read_back(results, fit, tmp_path, name):
    source = read_source(results)
    write_tiff(tmp_path, source)
    mask = source.maps.mask
    expected = 10 * fit.depth.depth if name == "depth" else getattr(source.maps, name)
    expected = np.atleast_3d(expected)
    with rasterio.open(tmp_path / f"{name}.tif") as file:
        image = np.moveaxis(file.read(), 0, 2)
        assert image.dtype == np.float32 and np.isnan(file.nodata)
        np.testing.assert_array_equal(file.read_masks(1) > 0, mask)
        told = json.loads(file.tags()["TIFFTAG_IMAGEDESCRIPTION"])
    np.testing.assert_allclose(image[mask], expected[mask], rtol=1e-6)
    assert np.isnan(image[~mask]).all()
    assert told["map"] == name
    assert told.get("unit") == {"depth": "mm", "normal_sigma_deg": "degree"}.get(name)
    assert told.get("wavelength_nm") == ([405, 530, 620] if name.startswith("reflectance") else None)
