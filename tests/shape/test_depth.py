"""Depth from normals, against surfaces with a formula."""

import numpy as np
import OpenEXR
import pytest

from evsdr.errors import InputError
from evsdr.model.view import CameraGeometry
from evsdr.shape.depth import integrate_normals, write_depth
from evsdr.shape.laplacian import ends


def orthographic(height, width, size=0.02):
    return CameraGeometry(False, (size, size), (width / 2, height / 2))


def surface(camera, height, width, z):
    """Give normals and depth of a height z(x, y) -> (z, dz/dx, dz/dy) under an orthographic camera."""
    x, y, _ = np.moveaxis(camera.points(np.zeros((height, width))), -1, 0)
    z, slope_x, slope_y = np.broadcast_arrays(*z(x, y))
    normal = np.stack([-slope_x, -slope_y, np.ones_like(z)], axis=-1)
    return normal / np.linalg.norm(normal, axis=-1, keepdims=True), 5 - z


def tilt(normal, deg, rng):
    """Tilt normals at random by a standard deviation of deg about each of two axes."""
    noise = np.radians(deg) * rng.normal(size=normal.shape)
    normal = normal + noise - np.sum(noise * normal, axis=-1, keepdims=True) * normal
    return normal / np.linalg.norm(normal, axis=-1, keepdims=True)


def rms(result, truth):
    """Root mean square error of depth over the mask."""
    return np.sqrt(np.mean((result.depth - truth)[result.mask] ** 2))


def sphere(camera, height, width, center_depth=5.0):
    """Give normals, depth and mask of the unit sphere on the optical axis."""
    sight = camera.points(np.ones((height, width)))
    if camera.perspective:
        a, b, c = np.sum(sight**2, axis=-1), center_depth, center_depth**2 - 1
        root = b**2 - a * c
        depth = (b - np.sqrt(np.maximum(root, 0))) / a
    else:
        root = 1 - np.sum(sight[..., :2] ** 2, axis=-1)
        depth = center_depth - np.sqrt(np.maximum(root, 0))
    normal = camera.points(depth) + [0, 0, center_depth]
    return normal, depth, root > 0


def relief(x, y):
    return (
        0.05 * np.sin(9 * x + 1) * np.cos(6 * y) + 0.1 * x * y,
        0.45 * np.cos(9 * x + 1) * np.cos(6 * y) + 0.1 * y,
        -0.3 * np.sin(9 * x + 1) * np.sin(6 * y) + 0.1 * x,
    )


def flap(x, y):
    """A flap that rises out of a plane along x, smoothly at its foot and its sides, and ends in a jump."""
    fade = np.maximum(1 - y**2 / 0.64, 0)
    up = np.where((x > -0.5) & (x < 0.2), x + 0.5, 0)
    return 2 * up**2 * fade**2, 4 * up * fade**2, 2 * up**2 * 2 * fade * (-2 * y / 0.64)


def test_points():
    camera = CameraGeometry(False, (0.5, 0.25), (1.0, 2.0))
    np.testing.assert_allclose(camera.points(np.full((3, 4), 7.0))[0, 3], [1.25, 0.375, -7])
    camera = CameraGeometry(True, (0.5, 0.25), (1.0, 2.0))
    np.testing.assert_allclose(camera.points(np.full((3, 4), 2.0))[0, 3], [2.5, 0.75, -2])


def test_plane():
    camera = CameraGeometry(False, (0.02, 0.03), (10.0, 8.0))  # pixels that are not square
    normal, depth = surface(camera, 23, 36, lambda x, y: (0.7 * x - 2 * y, 0.7, -2.0))
    result = integrate_normals(3 * normal, np.ones((23, 36)), camera, anchor=depth)
    assert rms(result, depth) < 1e-5


@pytest.mark.parametrize("perspective", [False, True])
@pytest.mark.parametrize("n_reweight", [0, 30])
def test_sphere(perspective, n_reweight):
    """Exact up to its outline, where normals are steep: the chord rule holds on spheres.

    Reweighting believes the inner side of steep pixels more, which costs half a pixel at the outline.
    """
    camera = CameraGeometry(perspective, (0.05, 0.05) if not perspective else (0.01, 0.01), (22.0, 25.0))
    normal, depth, mask = sphere(camera, 48, 50)
    result = integrate_normals(normal, mask, camera, anchor=depth, n_reweight=n_reweight)
    sight = -camera.points(depth) if perspective else np.broadcast_to([0, 0, 1], normal.shape)
    inside = mask & (np.sum(normal * sight, axis=-1) > 0.2 * np.linalg.norm(sight, axis=-1))
    assert inside.sum() > 0.8 * mask.sum() > 800
    error = (result.depth - depth)[inside]
    assert np.ptp(error) < (0.02 if n_reweight else 1e-3)
    assert rms(result, depth) < (1e-2 if n_reweight else 5e-3)
    assert all((tie >= np.logical_and(*ends(inside, axis))).all() for axis, tie in enumerate(result.tied))
    np.testing.assert_allclose(result.depth[mask].mean(), depth[mask].mean(), rtol=1e-12)


@pytest.mark.parametrize("z", [relief, lambda x, y: (x**2 - 0.5 * y**2, 2 * x, -y)])
def test_second_order(z):
    """Half the pixel size, a quarter of the error."""
    errors = []
    for n in (24, 48, 96):
        camera = orthographic(n, n, 1.2 / n)
        normal, depth = surface(camera, n, n, z)
        errors.append(
            rms(integrate_normals(normal, np.ones((n, n)), camera, anchor=depth, n_reweight=0), depth)
        )
    assert errors[0] < 2e-3
    assert errors[0] / errors[1] > 3.3 and errors[1] / errors[2] > 3.3


def test_noise():
    """One degree of noise at every pixel is 0.017 pixels per step; its sum stays below a tenth of a pixel."""
    camera = orthographic(64, 64)
    normal, depth = surface(camera, 64, 64, relief)
    normal = tilt(normal, 1.0, np.random.default_rng(5))
    result = integrate_normals(normal, np.ones((64, 64)), camera, np.ones((64, 64)), depth)
    assert rms(result, depth) < 0.1 * 0.02


def perspective_flap(height, width):
    """Give camera, normals and depth of the flap as the perspective camera sees it: depth 5 exp(-h(x, y) / 5)."""
    camera = CameraGeometry(True, (0.4 / width, 0.4 / width), (width / 2, height / 2))
    x, y, _ = np.moveaxis(camera.points(np.ones((height, width))), -1, 0)
    h, slope_x, slope_y = flap(5 * x, 5 * y)
    depth = 5 * np.exp(-h / 5)
    # P = depth (x, y, -1); normal = dP/dx x dP/dy, with d depth = -depth (slope_x dx + slope_y dy)
    normal = np.stack([-slope_x, -slope_y, 1 - x * slope_x - y * slope_y], axis=-1)
    return camera, normal, depth


@pytest.mark.parametrize("perspective", [False, True])
@pytest.mark.parametrize("n", [48, 64])
def test_a_jump_in_one_part(perspective, n):
    """Sides that are tied around a jump tell its height; least squares smear it.

    The pixels next to it may hang on either side.
    """
    if perspective:
        camera, normal, depth = perspective_flap(n, n)
    else:
        camera = orthographic(n, n, 2 / n)
        normal, depth = surface(camera, n, n, flap)
    normal = tilt(normal / np.linalg.norm(normal, axis=-1, keepdims=True), 0.2, np.random.default_rng(1))
    plain, kept = (
        integrate_normals(normal, np.ones((n, n)), camera, anchor=depth, n_reweight=k) for k in (0, 30)
    )
    last = int(np.argmax(np.diff(depth, axis=1).max(axis=0)))

    def height(d):
        return d[:, last + 3] - d[:, last - 2]

    rows = height(depth) > 0.4
    assert rows.sum() > n / 4
    share = [np.mean(height(d.depth)[rows] / height(depth)[rows]) for d in (plain, kept)]
    assert share[0] < 0.3 and 0.85 < share[1] < 1.1
    cuts = ~kept.tied[1]
    assert cuts[rows, last - 2 : last + 3].any(axis=1).all()
    assert (
        not cuts[:, : last - 2].any() and not cuts[:, last + 3 :].any() and kept.tied[0][:, : last - 2].all()
    )


def test_all_is_tied_on_a_smooth_surface():
    """Noise of five degrees cuts nothing."""
    camera = orthographic(64, 64)
    normal, depth = surface(camera, 64, 64, relief)
    normal = tilt(normal, 5.0, np.random.default_rng(5))
    result = integrate_normals(normal, np.ones((64, 64)), camera, anchor=depth)
    assert all(tie.all() for tie in result.tied)
    np.testing.assert_allclose(np.linalg.norm(result.normal, axis=-1), 1)


def test_sigma(rng):
    """Normals of which nothing is known do not spoil their neighbours, even without reweighting."""
    camera = orthographic(64, 64)
    normal, depth = surface(camera, 64, 64, relief)
    unknown = rng.random((64, 64)) < 0.1
    normal[unknown] = [0.9, 0, np.sqrt(0.19)]
    mask, sigma = np.ones((64, 64)), np.where(unknown, 180.0, 0.5)
    told, untold = (integrate_normals(normal, mask, camera, s, depth, 0) for s in (sigma, None))
    assert rms(told, depth) < 0.015 * 0.02
    assert rms(untold, depth) > 0.02


def test_nothing_known():
    result = integrate_normals(
        np.full((9, 9, 3), [0.6, 0, 0.8]), np.ones((9, 9)), orthographic(9, 9), np.full((9, 9), 180.0)
    )
    assert np.isfinite(result.depth).all()


def test_mask_with_holes_and_components():
    """Each component hangs on its own anchor; what is outside the mask is not looked at."""
    camera = orthographic(40, 60)
    normal, depth = surface(camera, 40, 60, relief)
    mask = np.ones((40, 60), bool)
    mask[:, 30:33] = False
    mask[10:15, 5:12] = False
    mask[3, 40:59] = False
    normal[~mask] = np.nan
    sigma = np.where(mask, 1.0, np.nan)
    result = integrate_normals(normal, mask, camera, sigma, 2.0)
    assert result.component.max() == 2 and (result.component > 0).tolist() == mask.tolist()
    assert (result.depth[~mask] == 0).all()
    for k in (1, 2):
        part = result.component == k
        np.testing.assert_allclose(result.depth[part].mean(), 2.0, rtol=1e-12)
        error = result.depth[part] - depth[part]
        assert np.std(error) < 2e-4
    anchored = integrate_normals(normal, mask, camera, sigma, np.where(mask, depth, np.nan))
    for k in (1, 2):
        part = result.component == k
        np.testing.assert_allclose(anchored.depth[part].mean(), depth[part].mean(), rtol=1e-12)


def test_perspective_scale():
    camera = CameraGeometry(True, (0.02, 0.02), (8.0, 8.0))
    normal = np.full((16, 16, 3), [0.3, -0.2, 0.9])
    near, far = (integrate_normals(normal, np.ones((16, 16)), camera, anchor=a) for a in (1.0, 700.0))
    np.testing.assert_allclose(far.depth, 700 * near.depth)
    np.testing.assert_allclose(near.depth.mean(), 1)
    points = near.points - near.points[0, 0]
    assert np.abs(points @ [0.3, -0.2, 0.9]).max() < 1e-5  # a plane stays a plane
    assert np.ptp(near.depth) > 0.05


def test_one_pixel():
    mask = np.zeros((5, 6))
    mask[2, 3] = 1
    result = integrate_normals(np.ones((5, 6, 3)), mask, orthographic(5, 6), anchor=4.0)
    assert result.depth[2, 3] == 4 and np.count_nonzero(result.depth) == 1


def test_defaults_of_the_anchor():
    normal, mask = np.full((4, 4, 3), [0.3, 0, 0.9]), np.ones((4, 4))
    assert abs(integrate_normals(normal, mask, orthographic(4, 4)).depth.mean()) < 1e-12
    camera = CameraGeometry(True, (0.1, 0.1), (2.0, 2.0))
    assert abs(integrate_normals(normal, mask, camera).depth.mean() - 1) < 1e-12


@pytest.mark.parametrize("perspective", [False, True])
def test_normals_away_from_the_camera(perspective, rng):
    """Whatever the normals, depth is finite, and positive under perspective."""
    camera = CameraGeometry(perspective, (0.1, 0.1), (10.0, 10.0))
    normal = rng.normal(size=(20, 20, 3))
    normal[5:8, 5:8] = [0, 0, -1]
    normal[9:12, 9:12] = [1, 0, 0]
    result = integrate_normals(normal, np.ones((20, 20)), camera)
    assert np.isfinite(result.depth).all()
    assert not perspective or (result.depth > 0).all()


def test_normals_from_behind_are_turned():
    """Normals that point away count as steep ones; if they are known to be wrong, the surface stays where it is."""
    camera = orthographic(64, 64)
    normal, depth = surface(camera, 64, 64, relief)
    normal[30:33, 30:33] = [0.6, 0, -0.8]
    normal[10, 10:30] = [0, 0.6, -0.8]
    sigma = np.where(normal[..., 2] < 0, 90.0, 1.0)
    told, untold = (integrate_normals(normal, np.ones((64, 64)), camera, s, depth) for s in (sigma, None))
    assert rms(told, depth) < 0.1 * 0.02 and rms(untold, depth) < 0.4 * 0.02


def test_bad_input():
    camera, normal, mask = orthographic(4, 5), np.full((4, 5, 3), [0, 0, 1.0]), np.ones((4, 5))
    hole = normal.copy()
    hole[1, 1] = 0
    cases = [
        ("selects no pixel", dict(mask=np.zeros((4, 5)))),
        ("normal has shape", dict(normal=normal[:3])),
        ("sigma_deg has shape", dict(sigma_deg=np.ones(5))),
        ("anchor has shape", dict(anchor=np.ones(3))),
        ("normal is zero or not finite", dict(normal=hole)),
        ("normal is zero or not finite", dict(normal=np.full((4, 5, 3), np.nan))),
        ("sigma_deg is negative", dict(sigma_deg=np.full((4, 5), -1.0))),
        ("sigma_deg is negative or not finite", dict(sigma_deg=np.full((4, 5), np.nan))),
        ("anchor must be finite", dict(anchor=np.inf)),
        ("positive for a perspective", dict(anchor=0.0, camera=CameraGeometry(True, (0.1, 0.1), (2.0, 2.0)))),
        ("pixel_size is", dict(camera=CameraGeometry(False, (0.1, 0.0), (2.0, 2.0)))),
        ("n_reweight is -1", dict(n_reweight=-1)),
    ]
    for message, change in cases:
        with pytest.raises(InputError, match=message):
            integrate_normals(**(dict(normal=normal, mask=mask, camera=camera) | change))


def test_depth_exr(tmp_path):
    camera = orthographic(6, 9)
    normal, depth = surface(camera, 6, 9, relief)
    mask = np.ones((6, 9), bool)
    mask[0, 0] = False
    result = integrate_normals(normal, mask, camera, anchor=depth)
    write_depth(tmp_path / "depth.exr", result)
    with OpenEXR.File(str(tmp_path / "depth.exr"), separate_channels=True) as file:
        assert list(file.channels()) == ["Z"]
        np.testing.assert_array_equal(file.channels()["Z"].pixels, result.depth.astype(np.float32))
        assert file.channels()["Z"].pixels[0, 0] == 0  # no NaN: 0 is what is not known, and the file says so
        assert file.header()["comments"].endswith("[scene units]; 0: not known")
    assert [file.name for file in tmp_path.iterdir()] == ["depth.exr"]
    with pytest.raises(InputError, match="cannot be written"):
        write_depth(tmp_path / "missing" / "depth.exr", result)
