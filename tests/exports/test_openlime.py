"""The bundle for OpenLIME: pictures opened by Pillow, and all that its layers ask for."""

import json
import re
from dataclasses import replace

import numpy as np
from PIL import Image

from evsdr.exports.openlime import write_openlime
from evsdr.exports.source import read_source
from evsdr.files.daylight import reflectance_to_srgb

ROUNDING = 0.51 / 255
JPEG = 6 / 255  # measured on noise, which it keeps worst: 99 % are within 2.4, all within 4


def opened(path):
    with Image.open(path) as image:
        assert image.mode == "RGB"
        return np.asarray(image) / 255


def test_colour_and_normals(results, tmp_path):
    source = read_source(results)
    write_openlime(tmp_path, source)
    maps, mask = source.maps, source.maps.mask
    colour = reflectance_to_srgb(maps.reflectance, maps.band_wavelength_nm)
    np.testing.assert_allclose(opened(tmp_path / "colour.png")[mask], colour[mask], atol=ROUNDING)
    normal = 2 * opened(tmp_path / "normals.png") - 1
    np.testing.assert_allclose(normal[mask], maps.normal[mask], atol=2 * ROUNDING)
    assert (np.linalg.norm(normal[~mask], axis=-1) < 0.5).all()  # OpenLIME shows nothing there


def test_bands_and_their_wavelengths(results, tmp_path):
    source = read_source(results)
    maps, mask = source.maps, source.maps.mask
    bands = np.repeat(maps.reflectance, 2, axis=2)[..., :5]
    nm = np.float32([405, 450, 530, 570, 620])
    five = replace(maps, reflectance=bands, reflectance_sigma=bands, band_wavelength_nm=nm)
    write_openlime(tmp_path, replace(source, maps=five))
    info = json.loads((tmp_path / "info.json").read_text())
    assert info["wavelength"] == nm.tolist() and info["nplanes"] == 5 and info["nimg"] == 2
    assert (info["height"], info["width"]) == mask.shape and info["pixelSizeInMM"] == source.pixel_mm
    pictures = [opened(tmp_path / f"{info['basename']}_{k:02d}.jpg") for k in range(info["nimg"])]
    shown = np.concatenate(pictures, axis=2)
    np.testing.assert_allclose(shown[mask][:, :5], bands[mask], atol=JPEG)
    assert shown[..., 5].max() < JPEG
    weights = json.loads((tmp_path / "presets.json").read_text())["Daylight"]
    linear = np.stack([bands[mask] @ weights[name] for name in ("red", "green", "blue")], axis=1)
    srgb = reflectance_to_srgb(bands[mask], nm)
    inside = (linear > 0.01) & (linear < 1)
    np.testing.assert_allclose(linear[inside], (((srgb + 0.055) / 1.055) ** 2.4)[inside], rtol=0.05)


def test_the_page_names_what_lies_beside_it(results, tmp_path):
    write_openlime(tmp_path, read_source(results))
    named = set(re.findall(r'"([\w.]+\.(?:png|json))"', (tmp_path / "index.html").read_text()))
    assert named == {"colour.png", "normals.png", "info.json", "presets.json"}
    assert named <= {file.name for file in tmp_path.iterdir()}
