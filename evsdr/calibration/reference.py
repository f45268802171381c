"""`calibrate reference`, `calibrate scale` and `calibrate pose`: read, estimate, write."""

import copy
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np

from evsdr.calibration import chart as colours
from evsdr.calibration import draw
from evsdr.calibration import pose as poses
from evsdr.calibration.leds import load_ring
from evsdr.calibration.scene_text import flatten, include_text
from evsdr.errors import InputError, check_range, parse_definitions
from evsdr.files.mask import read_mask
from evsdr.files.results import encode_normal
from evsdr.light.camera import view_of
from evsdr.metrics import angular_error_deg
from evsdr.model.view import depth_of_origin
from evsdr.records import Maps


def reference(options, folder: Path) -> tuple[dict, list]:
    """Project spectra on the bands; writes reference.csv and reserved.csv."""
    ring = load_ring(options.scene, options.define)
    spectra = colours.read_spectra(options.spectra)
    if options.white:
        spectra = colours.over_white(spectra, options.white, options.white_reflectance)
    bands = ring.leds.band_spectrum
    everything = colours.project(spectra, bands)
    table = colours.choose(everything, list(options.patches))
    colours.write_table(folder / "reference.csv", table)
    if options.reserved:
        colours.write_table(folder / "reserved.csv", colours.choose(everything, [options.reserved]))
    draw.draw_reference(folder / "residuals.png", spectra, table, bands, colours.WAVELENGTH_NM)
    result = {
        "scene": str(options.scene),
        "spectra": options.spectra,
        "band_nm": table.band_nm.tolist(),
        "patches": [
            {"name": name, "number": int(number), "reflectance": value.tolist(), "sigma": sigma.tolist()}
            for name, number, value, sigma in zip(table.name, table.number, table.value, table.sigma)
        ],
    }
    rows = [("table", f"{len(table.name)} patches x {len(table.band_nm)} bands")]
    rows.append(("sigma, largest", f"{table.sigma.max():.2g}"))
    return result, rows


def scale(options, folder: Path) -> tuple[dict, list]:
    """Find the absolute scale from a reserved patch, judge the others; writes evaluation.csv."""
    maps = _read_maps(options.maps)
    shape = maps.mask.shape
    if options.labels:
        label = _read_labels(options.labels, shape)
    elif options.corners:
        corner = np.array(options.corners).reshape(4, 2)
        label = colours.chart_labels(corner, shape, options.rows, options.columns, options.gap)
    else:
        raise InputError("nothing tells where the patches are; give --corners or --labels.")
    table = colours.read_table(options.reference)
    found = colours.find_scale(maps, label, colours.read_table(options.reserved), table)
    colours.write_table(folder / "evaluation.csv", found.measured)
    if options.constant_light is not None:
        light = options.constant_light * found.scale
        text = include_text(
            "Constant light as evsdr.calibrate scale found it; include it before any other default.",
            [],
            {"constant_light": light},
        )
        (folder / "constant_light.xml").write_text(text)
    draw.draw_scale(folder / "residuals.png", found, table)
    result = {
        "maps": str(options.maps),
        "scale": {"value": found.scale, "sigma": found.sigma},
        "reserved": {"name": found.reserved.name[0], "number": int(found.reserved.number[0])},
        "rmse": float(found.rmse.mean()),
        "sam_deg": float(found.sam_deg.mean()),
        "patches": [
            {
                "name": name,
                "number": int(number),
                "rmse": float(rmse),
                "sam_deg": float(sam),
                "reflectance": value.tolist(),
                "sigma": sigma.tolist(),
            }
            for name, number, rmse, sam, value, sigma in zip(
                table.name,
                table.number,
                found.rmse,
                found.sam_deg,
                found.measured.value,
                found.measured.sigma,
            )
        ],
    }
    rows = [("scale", f"{found.scale:.4f} +- {found.sigma:.2g}")]
    rows += [
        (f"{name}: RMSE, spectral angle [deg]", f"{rmse:.4f}, {sam:.2f}")
        for name, rmse, sam in zip(table.name, found.rmse, found.sam_deg)
    ]
    rows.append(
        (f"mean of {len(table.name)} patches", f"{found.rmse.mean():.4f}, {found.sam_deg.mean():.2f}")
    )
    if options.constant_light is not None:
        result["constant_light"] = {"value": light, "sigma": options.constant_light * found.sigma}
        rows.append(("C_w", f"{light:.5g} +- {options.constant_light * found.sigma:.2g}"))
    return result, rows


def _read_labels(path: Path, shape: tuple[int, int]) -> np.ndarray:
    try:
        label = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise InputError(
            f"{path}: not a readable .npy image; save the numbers of the patches by numpy.save."
        ) from error
    if getattr(label, "shape", None) != shape or label.dtype.kind not in "iu":
        raise InputError(
            f"{path}: labels must be whole numbers of shape (height, width) = {shape}; save them so."
        )
    return label


def _read_maps(path: Path) -> Maps:
    """Read a maps.npz."""
    if not path.is_file():
        raise InputError(f"{path}: there is no such file; name a maps.npz of evsdr.fit.")
    names = list(Maps.__dataclass_fields__)
    try:
        with np.load(path, allow_pickle=False) as file:
            maps = Maps(**{name: file[name] for name in names})
        height, width = maps.mask.shape
        right = maps.normal.shape == (height, width, 3)
        right &= maps.reflectance.shape == (height, width, len(maps.band_wavelength_nm))
    except Exception as error:  # NumPy, zipfile and zlib raise ten kinds on damage
        raise InputError(f"{path}: not a maps.npz with {', '.join(names)}; write it by evsdr.fit.") from error
    if not right or not all(np.isfinite(getattr(maps, name)).all() for name in names):
        raise InputError(
            f"{path}: its arrays have other shapes than evsdr.fit writes, or are not finite; fit again."
        )
    return maps


def pose(options, folder: Path) -> tuple[dict, list]:
    """Find the pose of a CAD model; writes pose.xml, object.ply, scene.xml and truth.npz."""
    check_range("--spp", options.spp, 1)
    ring = load_ring(options.scene, options.define)
    from evsdr.light.ground_truth import surface_maps
    from evsdr.light.scene import load_scene

    view, shape = view_of(ring), (ring.height, ring.width)
    mesh, model = poses.read_model(options.mesh, options.unit)
    evidence = poses.Evidence()
    if options.points:
        pixel, point = poses.read_points(options.points)
        evidence = replace(evidence, point_pixel=pixel, point_model=point)
    if options.mask:
        evidence = replace(evidence, mask=read_mask(options.mask, shape))
    if options.maps:
        maps = _read_maps(options.maps)
        if maps.mask.shape != shape:
            raise InputError(f"{options.maps}: it is not as large as the film of {options.scene}; fit again.")
        evidence = replace(evidence, normal=maps.normal * maps.mask[..., None])
    found = poses.find_pose(view, model, evidence, depth_of_origin(view, options.center_z))
    matrix = poses.world_matrix(view, model, found)
    (folder / "object.ply").write_bytes(mesh.export(file_type="ply", vertex_normal=True))
    root = flatten(options.scene, parse_definitions(options.define))
    posed = _posed_object(root, matrix, "object.ply", options.face_normals)
    elsewhere = copy.deepcopy(
        posed
    )  # an include is read from any folder, and the mesh beside it is not found
    elsewhere.find("string").set("value", str(folder.parent.resolve() / "object.ply"))
    (folder / "pose.xml").write_text(
        include_text("The object as evsdr.calibrate pose placed it.", [elsewhere])
    )
    ET.indent(root, "    ")
    (folder / "scene.xml").write_text(ET.tostring(root, encoding="unicode") + "\n")
    truth = surface_maps(load_scene(folder / "scene.xml"), options.spp)
    if not truth.mask.any():
        raise InputError("the camera does not see the posed mesh; check --unit, --points and --mask.")
    np.savez(folder / "truth.npz", normal=truth.normal, reflectance=truth.reflectance, mask=truth.mask)
    image = encode_normal(truth.normal, truth.mask) / 65535
    seen = view.project(
        (model.unit * (evidence.point_model - model.middle)) @ found.rotation.T + found.translation
    )
    draw.draw_pose(folder / "residuals.png", image, found, evidence.point_pixel, seen)
    result = {
        "scene": str(options.scene),
        "mesh": str(options.mesh),
        "to_world": matrix.tolist(),
        "rotation_sigma_deg": found.rotation_sigma_deg.tolist(),
        "translation_sigma": found.translation_sigma.tolist(),
        "depth": "estimated" if view.camera.perspective else "not seen by an orthographic camera; kept",
        "truth_pixels": int(truth.mask.sum()),
    }
    rows = [
        ("sigma of the rotation [deg]", f"{np.linalg.norm(found.rotation_sigma_deg):.3f}"),
        ("sigma of the place [scene units]", f"{np.linalg.norm(found.translation_sigma):.2g}"),
    ]
    for name, residual in (("points", found.point_residual), ("outline", found.outline_residual)):
        if len(residual):
            result[f"{name}_rms_pixels"] = float(np.sqrt(np.mean(residual**2)))
            rows.append((f"{name}, rms [pixels]", f"{result[f'{name}_rms_pixels']:.3f}"))
    if options.mask:
        result["mask_drawn_inside_pixels"] = {
            "value": found.outline_offset,
            "sigma": found.outline_offset_sigma,
        }
    if options.maps:
        both = truth.mask & maps.mask
        angle = (
            float(angular_error_deg(maps.normal[both], truth.normal[both]).mean()) if both.any() else 180.0
        )
        result["mean_angle_to_maps_deg"] = angle
        rows.append(("mean angle to the fitted normals [deg]", f"{angle:.3f}"))
    return result, rows


def _posed_object(root, matrix: np.ndarray, filename: str, face_normals: bool):
    """Put the posed mesh in the place of the scene's object; gives its element."""
    old = next((e for e in root if e.tag == "shape" and e.get("id") == "object"), None)
    if old is None:
        raise InputError(
            'the scene file has no shape with id="object" whose place the mesh could take; add one.'
        )
    posed = ET.Element("shape", type="ply", id="object")
    ET.SubElement(posed, "string", name="filename", value=filename)
    if face_normals:
        ET.SubElement(posed, "boolean", name="face_normals", value="true")
    transform = ET.SubElement(posed, "transform", name="to_world")
    ET.SubElement(transform, "matrix", value=" ".join(f"{v:.9g}" for v in matrix.ravel()))
    posed.extend(child for child in old if child.tag in ("bsdf", "ref"))
    root[list(root).index(old)] = posed
    return posed
