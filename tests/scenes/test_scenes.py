"""The scene library: opens in plain Mitsuba, and is what its README says."""

import re
import shutil
from pathlib import Path

import numpy as np
import png
import pytest
import trimesh
from evsdr.scenes import make_colorchecker, make_meshes, make_rigs, make_surfaces

SCENES = Path(make_rigs.__file__).resolve().parent
NAMES = ["sphere", "sphere_pole", "blob", "relief", "colorchecker", "near_ring", "soft_ring"]
RIGS = {"sphere": "far", "near_ring": "near", "soft_ring": "soft"}
LED_IDS = [f"led_{j:02d}" for j in range(24)]
GENERATORS = [make_rigs, make_surfaces, make_meshes, make_colorchecker]


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """Open a scene by name in plain Mitsuba, as the integrator `direct`."""
    import mitsuba as mi

    folder = tmp_path_factory.mktemp("plain")
    shutil.copytree(SCENES, folder, ignore=shutil.ignore_patterns("*.py", "__pycache__"), dirs_exist_ok=True)
    ring = re.compile('<integrator type="ring">.*?</integrator>', re.DOTALL)
    for name in NAMES:
        text = (folder / f"{name}.xml").read_text()
        text, n = ring.subn('<integrator type="direct"/>', text)
        assert n == 1
        (folder / f"{name}.xml").write_text(text)

    def load(name, **define):
        define = {"size": 32, "spp": 4} | define
        return mi.load_file(
            str(folder / f"{name}.xml"), optimize=False, **{key: str(value) for key, value in define.items()}
        )

    return load


def leds_of(scene):
    """Give a scene's emitters by id, in order."""
    shapes = [(e, e.get_shape()) for e in scene.emitters()]
    named = {e.id() if shape is None else shape.id(): e for e, shape in shapes}
    return {name: named[name] for name in sorted(named)}


def object_of(scene):
    (found,) = [shape for shape in scene.shapes() if shape.id() == "object"]
    return found


def packets(wavelength_nm):
    """Lay wavelengths, a multiple of four, out as packets of four."""
    import mitsuba as mi

    return mi.Spectrum(np.ascontiguousarray(np.reshape(wavelength_nm, (-1, 4)).T, np.float32))


def diffuse_reflectance(bsdf, si, wavelength_nm):
    """Evaluate a bsdf at the points of `si`, (n_point, n_wavelength), n_wavelength a multiple of four."""
    import drjit as dr
    import mitsuba as mi

    columns = []
    for four in np.reshape(wavelength_nm, (-1, 4)).tolist():
        si.wavelengths = mi.Spectrum(four)
        dr.make_opaque(si.wavelengths)  # one kernel for all wavelengths
        columns.append(np.array(bsdf.eval_diffuse_reflectance(si)).T)
    return np.hstack(columns)


@pytest.mark.parametrize("name", NAMES)
def test_scene_opens_in_plain_mitsuba(plain, name):
    import mitsuba as mi

    scene = plain(name)
    assert [sensor.id() for sensor in scene.sensors()] == ["camera"]
    assert list(leds_of(scene)) == LED_IDS
    object_of(scene)
    image = np.array(mi.render(scene))
    assert image.shape == (32, 32, 3)
    assert np.isfinite(image).all()
    lit = image.max(axis=2) > 0
    assert np.ptp(np.flatnonzero(lit.any(axis=0))) + 1 >= 0.8 * 32  # the object fills the film's width
    if name != "relief":
        assert not lit[0].any() and not lit[-1].any() and not lit[:, 0].any() and not lit[:, -1].any()


def test_camera_frame_is_x_right_y_up():
    import mitsuba as mi

    text = (SCENES / "camera.xml").read_text()
    lamp = """<integrator type="direct"/><shape type="sphere"><point name="center" x="0.6" y="0.3" z="0"/>
        <float name="radius" value="0.2"/><emitter type="area"/></shape></scene>"""
    scene = mi.load_string(text.replace("</scene>", lamp), size="64", spp="4")
    row, column = np.nonzero(np.array(mi.render(scene)).sum(axis=2))
    assert column.mean() + 0.5 == pytest.approx(32 * (1 + 0.6 / 1.15), abs=0.5)
    assert row.mean() + 0.5 == pytest.approx(32 * (1 - 0.3 / 1.15), abs=0.5)


@pytest.mark.parametrize("name", RIGS)
def test_ring_geometry(plain, name):
    """LED j stands at azimuth 15 j and polar angle 45 degrees, as the origin sees it."""
    import drjit as dr
    import mitsuba as mi

    scene = plain(name)
    origin = dr.zeros(mi.SurfaceInteraction3f)
    sample = [led.sample_direction(origin, mi.Point2f(0.5))[0] for led in leds_of(scene).values()]
    direction = np.array([np.array(ds.d).ravel() for ds in sample])
    azimuth = np.rad2deg(np.arctan2(direction[:, 1], direction[:, 0])) % 360
    # a turn of 360 is none
    np.testing.assert_allclose((azimuth - 15 * np.arange(24) + 180) % 360 - 180, 0, atol=1e-3)
    np.testing.assert_allclose(np.rad2deg(np.arccos(direction[:, 2])), 45, atol=1e-3)
    if RIGS[name] != "far":
        np.testing.assert_allclose([ds.dist[0] for ds in sample], 3.5, atol=1e-5)


@pytest.mark.parametrize("name", RIGS)
def test_each_led_gives_unit_irradiance_at_the_origin(plain, name):
    import drjit as dr
    import mitsuba as mi

    scene = plain(name)
    wavelength = np.arange(360.0, 832.0)
    spectra = []
    for led, toward in zip(leds_of(scene).values(), make_rigs.light_directions().tolist()):
        si = dr.zeros(mi.SurfaceInteraction3f, len(wavelength) // 4)
        si.wavelengths = packets(wavelength)
        total = mi.Spectrum(0.0)
        offsets = [1 / 6, 1 / 2, 5 / 6]  # midpoint rule over the LED's square
        for u in offsets:
            for v in offsets:
                ds, radiance_over_pdf = led.sample_direction(si, mi.Point2f(u, v))
                total += radiance_over_pdf * dr.dot(ds.d, mi.Vector3f(toward)) / len(offsets) ** 2
        spectra.append(np.array(total).T.ravel())
    spectra = np.array(spectra)
    np.testing.assert_allclose(np.trapezoid(spectra, wavelength), 1, atol=1e-3)
    np.testing.assert_allclose(spectra[8:], spectra[:-8], atol=1e-5)  # band j mod 8
    peak = wavelength[spectra[:8].argmax(axis=1)]
    assert peak.tolist() == [405, 430, 460, 490, 525, 560, 595, 635]
    width = np.sum(spectra[:8] > 0.5 * spectra[:8].max(axis=1, keepdims=True), axis=1)  # in steps of 1 nm
    assert width.min() >= 14 and width.max() <= 36


def cast_shadow_share(scene, size=128):
    """Share of the object's pixels in the cast shadow of at least one far LED of the ring."""
    import drjit as dr
    import mitsuba as mi

    v, u = (np.mgrid[:size, :size].reshape(2, -1) + 0.5) / size
    ray, _ = scene.sensors()[0].sample_ray(0.0, 0.5, mi.Point2f(u, v), mi.Point2f(0.5))
    si = scene.ray_intersect(ray)
    on_object = si.is_valid() & (si.shape == mi.ShapePtr(object_of(scene)))
    shadowed = mi.Bool(False)
    for toward in make_rigs.light_directions().tolist():
        faces = on_object & (dr.dot(si.sh_frame.n, mi.Vector3f(toward)) > 0.02)
        shadowed |= faces & scene.ray_test(si.spawn_ray(mi.Vector3f(toward)), faces)
    return np.count_nonzero(shadowed) / np.count_nonzero(on_object)


@pytest.mark.parametrize(
    "name, least, most",
    [("sphere", 0, 0), ("sphere_pole", 0.1, 0.3), ("blob", 0.15, 0.4), ("relief", 0.3, 0.7)],
)
def test_cast_shadow_share(plain, name, least, most):
    assert least <= cast_shadow_share(plain(name)) <= most


@pytest.mark.parametrize("n_basis", [1, 3, 8])
def test_reflectance_has_the_spectral_rank(plain, n_basis):
    import drjit as dr
    import mitsuba as mi

    bsdf = object_of(plain("sphere", bases=n_basis)).bsdf()
    side = (np.arange(64) + 0.5) / 64
    u, v = np.meshgrid(side, side)
    si = dr.zeros(mi.SurfaceInteraction3f, u.size)
    si.uv = mi.Point2f(u.ravel(), v.ravel())
    si.wi = mi.Vector3f(0, 0, 1)
    reflectance = diffuse_reflectance(bsdf, si, [peak for peak, *_ in make_rigs.BANDS])
    assert reflectance.min() >= 0.05 and reflectance.max() <= 0.9
    strength = np.linalg.svd(reflectance, compute_uv=False)
    assert strength[n_basis - 1] > 0.01 * strength[0]
    assert np.all(strength[n_basis:] < 1e-5 * strength[0])


def test_colorchecker_patches_have_their_spectra(plain):
    """Shoot a ray at the middle of each patch, and at the border, and read the reflectance there."""
    import colour
    import mitsuba as mi

    scene = plain("colorchecker")
    board = object_of(scene)
    column, row = np.meshgrid(np.arange(6), np.arange(4))
    x = np.append((column.ravel() - 2.5) * 0.32, 0.0)  # the last point is on the border
    y = np.append((1.5 - row.ravel()) * 0.32, 0.0)
    tilt = mi.ScalarTransform4f().rotate([0.8, 0.6, 0], 15)
    origin = mi.Transform4f(tilt) @ mi.Point3f(x, y, np.full(25, 1.0))
    si = scene.ray_intersect(mi.Ray3f(origin, mi.Vector3f(tilt @ mi.ScalarVector3f(0, 0, -1))))
    assert np.all(np.array(si.shape == mi.ShapePtr(board)))
    np.testing.assert_allclose(np.rad2deg(np.arccos(np.array(si.n.z))), 15, atol=1e-3)

    wavelength = np.arange(385.0, 730.0, 5)[:68]
    measured = diffuse_reflectance(board.bsdf(), si, wavelength)
    chart = colour.SDS_COLOURCHECKERS["BabelColor Average"].values()
    expected = [np.interp(wavelength, patch.wavelengths, patch.values) for patch in chart]
    np.testing.assert_allclose(measured[:24], expected, atol=1e-5)
    np.testing.assert_allclose(measured[24], 0.04, atol=1e-6)


@pytest.mark.parametrize("mesh", [make_meshes.blob(), make_meshes.relief()], ids=["blob", "relief"])
def test_analytic_normals_fit_the_triangles(mesh):
    surface = trimesh.Trimesh(mesh.position, mesh.face, process=False)
    cosine = np.sum(surface.vertex_normals * mesh.normal, axis=1)
    assert np.rad2deg(np.arccos(np.clip(cosine, -1, 1))).mean() < 1
    np.testing.assert_allclose(np.linalg.norm(mesh.normal, axis=1), 1, atol=1e-12)


def test_blob_is_closed_and_just_fits_the_unit_cube():
    mesh = make_meshes.blob()
    assert trimesh.Trimesh(mesh.position, mesh.face, process=False).is_watertight
    assert np.abs(mesh.position).max() == pytest.approx(1, abs=1e-12)


def test_relief_covers_the_film():
    position = make_meshes.relief().position
    assert position[:, :2].min() < -1.15 and position[:, :2].max() > 1.15


@pytest.mark.parametrize("module", GENERATORS, ids=lambda module: module.__name__.split(".")[-1])
def test_generated_files_are_those_of_their_script(module, tmp_path):
    module.write(tmp_path)
    written = sorted(path.name for path in tmp_path.iterdir())
    assert written
    for name in written:
        new, old = tmp_path / name, SCENES / name
        if name.endswith((".xml", ".csv")):
            assert new.read_text() == old.read_text()
        elif name.endswith(".png"):  # compressed bytes depend on zlib, grey values on the last digit
            np.testing.assert_allclose(read_png(new), read_png(old), atol=1)
        else:
            (vertex, face), (old_vertex, old_face) = read_ply(new), read_ply(old)
            np.testing.assert_allclose(vertex, old_vertex, atol=1e-6)
            np.testing.assert_array_equal(face, old_face)


def read_png(path):
    return np.vstack(list(png.Reader(bytes=path.read_bytes()).asDirect()[2])).astype(int)


def read_ply(path):
    """Read back what `write_ply` writes."""
    header, body = path.read_bytes().split(b"end_header\n", 1)
    n_vertex = int(re.search(rb"element vertex (\d+)", header)[1])
    vertex = np.frombuffer(body, "<f4", 8 * n_vertex).reshape(-1, 8)
    return vertex, np.frombuffer(body[vertex.nbytes :], [("n", "u1"), ("index", "<i4", 3)])["index"]


def test_every_shared_file_is_small():
    size = [path.stat().st_size for path in SCENES.iterdir() if path.suffix in (".xml", ".ply", ".png")]
    assert max(size) < 1e6 and sum(size) < 3e6
