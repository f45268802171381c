"""ENVI cubes, opened by `spectral` and by GDAL."""

import numpy as np
import pytest
import rasterio
import spectral

from evsdr.exports.envi import UNKNOWN, write_envi
from evsdr.exports.source import read_source

# Pictures of a camera lie nowhere on the Earth.
pytestmark = pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")


@pytest.mark.parametrize("name", ["reflectance", "reflectance_sigma"])
def test_cube_is_read_back(results, tmp_path, name):
    source = read_source(results)
    write_envi(tmp_path, source)
    mask = source.maps.mask
    expected = np.where(mask[..., None], getattr(source.maps, name), UNKNOWN)
    cube = spectral.open_image(str(tmp_path / f"{name}.hdr"))
    np.testing.assert_array_equal(cube.open_memmap(), expected)
    assert cube.bands.centers == [405, 530, 620] and cube.bands.band_unit == "Nanometers"
    with rasterio.open(tmp_path / f"{name}.img") as file:
        assert file.driver == "ENVI" and file.nodata == UNKNOWN
        np.testing.assert_array_equal(np.moveaxis(file.read(), 0, 2), expected)
        assert "530" in file.descriptions[1] and "620" in file.descriptions[2]
        np.testing.assert_array_equal(file.read_masks(1) > 0, mask)
