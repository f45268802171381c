"""Residual pictures: written for each calibration, not blank, and of the data."""

from types import SimpleNamespace

import numpy as np
import png
import pytest

from evsdr.calibration import draw
from tests.support.analytic import ring_directions


def read(path):
    """Give a picture (height, width, 3)."""
    width, height, rows, _ = png.Reader(bytes=path.read_bytes()).asRGBA8()
    return np.array(list(rows)).reshape(height, width, 4)[..., :3]


def test_values_are_averaged_over_their_pixels():
    mean = draw.pixel_mean(np.array([1.0, 3.0, 5.0]), np.array([0, 0, 3]), (2, 2))
    np.testing.assert_array_equal(mean, [[2, np.nan], [np.nan, 5]])


def thresholds(rng):
    value = rng.uniform(0.2, 0.3, (8, 9))
    return SimpleNamespace(value=value, sigma=0.01 * value)


def picture(kind, path, rng, scale=1.0):
    """Draw some data; `scale` changes them."""
    n = 24
    light = ring_directions(n)
    table = SimpleNamespace(
        name=["a", "b"],
        band_nm=np.array([450.0, 620]),
        value=np.full((2, 2), 0.3 * scale),
        sigma=np.full((2, 2), 0.01),
    )
    nothing = np.empty((0, 2))
    if kind == "directions":
        image = scale * rng.normal(size=(8, 9))
        draw.draw_directions(path, light, light[::-1], np.ones(n), image, rng.normal(size=99), 1.0)
    elif kind == "mirror":
        draw.draw_directions(path, light, light, np.ones(n), scale * np.eye(9), None, None)
    elif kind == "powers":
        power = scale * np.linspace(0.8, 1.2, n)
        draw.draw_powers(path, np.ones(n), power, 0.1 * power, np.arange(60) % 3, rng.normal(size=60), 1.0)
    elif kind == "thresholds":
        draw.draw_thresholds(
            path,
            {
                "on": thresholds(rng),
                "off": SimpleNamespace(value=scale * np.eye(8) + 1, sigma=np.ones((8, 8))),
            },
        )
    elif kind == "reference":
        nm = np.arange(400.0, 701, 10)
        spectra = SimpleNamespace(
            name=["a", "b"], wavelength_nm=nm, value=scale * np.stack([nm / 1400, nm / 700])
        )
        bands = np.exp(-0.5 * ((nm - table.band_nm[:, None]) / 12) ** 2)
        draw.draw_reference(path, spectra, table, bands, nm)
    elif kind == "scale":
        found = SimpleNamespace(measured=table, rmse=np.array([0.01, 0.02]), sam_deg=np.array([1.0, 2]))
        draw.draw_scale(path, found, SimpleNamespace(**vars(table) | {"value": np.full((2, 2), 0.4)}))
    else:
        pose = SimpleNamespace(
            outline=nothing,
            contour=nothing,
            outline_residual=np.empty(0),
            point_residual=scale * rng.normal(size=20),
        )
        draw.draw_pose(
            path, np.full((8, 9, 3), 0.5), pose, np.array([[3.0, 4]]), np.array([[3.2, 4 * scale]])
        )


@pytest.mark.parametrize(
    "kind", ["directions", "mirror", "powers", "thresholds", "reference", "scale", "pose"]
)
def test_pictures_show_their_data(tmp_path, kind):
    pictures = []
    for i, scale in enumerate((1.0, 0.5)):
        picture(kind, tmp_path / f"{i}.png", np.random.default_rng(0), scale)
        pictures.append(read(tmp_path / f"{i}.png"))
    assert pictures[0].std() > 10  # not blank
    assert pictures[0].shape != pictures[1].shape or (pictures[0] != pictures[1]).any()
