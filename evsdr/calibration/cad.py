"""`calibrate pose`: read, estimate, write."""

import copy
import xml.etree.ElementTree as ET
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from evsdr.calibration import draw
from evsdr.calibration import pose as poses
from evsdr.calibration.scene_text import flatten, include_text
from evsdr.errors import InputError, check_range
from evsdr.files.maps import read_maps
from evsdr.files.mask import read_mask
from evsdr.files.results import encode_normal
from evsdr.files.truth import write_truth
from evsdr.light.camera import view_of
from evsdr.light.entry import open_scene
from evsdr.metrics import angular_error_deg
from evsdr.model.view import depth_of_origin
from evsdr.progress import Progress, silent
from evsdr.records import Maps


@dataclass(frozen=True)
class Cad:
    """A CAD model and what tells where it stands.

    Attributes
    ----------
    mesh : Path
        The model, in any format that trimesh reads.
    points : Path or None
        CSV of x_pixel,y_pixel,X,Y,Z: where points of the model are seen.
    mask : Path or None
        Image of the object's silhouette.
    maps : Path or None
        maps.npz whose normals refine the pose.
    unit : float
        Scene units per unit of the model.
    center_z : float
        How far the model's middle lies from the scene's origin toward the camera, to start from [scene units].
    face_normals : bool
        Flat faces instead of smooth normals.
    """

    mesh: Path
    points: Path | None = None
    mask: Path | None = None
    maps: Path | None = None
    unit: float = 1.0
    center_z: float = 0.0
    face_normals: bool = False


def pose(
    folder: Path,
    scene: Path,
    cad: Cad,
    spp: int = 16,
    define: dict[str, str] | None = None,
    progress: Progress = silent,
) -> dict:
    """Find the pose of a CAD model in the camera's view.

    Parameters
    ----------
    folder : Path
        Gets pose.xml, object.ply, scene.xml, truth.npz and residuals.png.
    scene : Path
        Scene file with the camera; the model replaces its object.
    cad : Cad
    spp : int
        Rays per pixel of the normal map.
    define : dict, optional
        Values for the `<default>` parameters of the scene file.
    progress : callable (detail, share), optional
        Told how far it is.

    Returns
    -------
    dict
        Every estimate and its sigma, as calibration.json holds them.

    Raises
    ------
    InputError
        Something given can't be used.
    """
    check_range("--spp", spp, 1)
    ring = open_scene(scene, define)
    view, shape = view_of(ring), (ring.height, ring.width)
    mesh, model = poses.read_model(cad.mesh, cad.unit)
    evidence, maps = poses.PoseEvidence(), None
    if cad.points:
        pixel, point = poses.read_points(cad.points)
        evidence = replace(evidence, point_pixel=pixel, point_model=point)
    if cad.mask:
        evidence = replace(evidence, mask=read_mask(cad.mask, shape))
    if cad.maps:
        maps = read_maps(cad.maps)
        if maps.mask.shape != shape:
            raise InputError(f"{cad.maps}: it is not as large as the film of {scene}; fit again.")
        evidence = replace(evidence, normal=maps.normal * maps.mask[..., None])
    found = poses.find_pose(view, model, evidence, depth_of_origin(view, cad.center_z), progress)
    matrix = poses.world_matrix(view, model, found)
    (folder / "object.ply").write_bytes(mesh.export(file_type="ply", vertex_normal=True))
    write_scenes(folder, flatten(scene, define or {}), matrix, cad.face_normals)
    truth = true_maps(folder / "scene.xml", spp)
    write_truth(folder / "truth.npz", truth)
    image = encode_normal(truth.normal, truth.mask) / 65535
    seen = view.project(
        (model.unit * (evidence.point_model - model.middle)) @ found.rotation.T + found.translation
    )
    draw.draw_pose(folder / "residuals.png", image, found, evidence.point_pixel, seen)
    result = {
        "scene": str(scene),
        "mesh": str(cad.mesh),
        "to_world": matrix.tolist(),
        "rotation_sigma_deg": found.rotation_sigma_deg.tolist(),
        "translation_sigma": found.translation_sigma.tolist(),
        "depth": "estimated" if view.camera.perspective else "not seen by an orthographic camera; kept",
        "truth_pixels": int(truth.mask.sum()),
    }
    for name, residual in (("points", found.point_residual), ("outline", found.outline_residual)):
        if len(residual):
            result[f"{name}_rms_pixels"] = float(np.sqrt(np.mean(residual**2)))
    if cad.mask:
        result["mask_drawn_inside_pixels"] = {
            "value": found.outline_offset,
            "sigma": found.outline_offset_sigma,
        }
    if maps:
        both = truth.mask & maps.mask
        angle = angular_error_deg(maps.normal[both], truth.normal[both])
        result["mean_angle_to_maps_deg"] = float(angle.mean()) if both.any() else 180.0
    return result


def true_maps(scene: Path, spp: int) -> Maps:
    """Render the truth of a scene; raises InputError where the camera doesn't see the mesh."""
    from evsdr.light.ground_truth import surface_maps

    truth = surface_maps(open_scene(scene), spp)
    if not truth.mask.any():
        raise InputError("the camera does not see the posed mesh; check --unit, --points and --mask.")
    return truth


def write_scenes(folder: Path, root: ET.Element, matrix: np.ndarray, face_normals: bool) -> None:
    """Put the mesh in the place of the scene's object; write pose.xml, to include, and the whole scene.xml."""
    posed = _posed_object(root, matrix, "object.ply", face_normals)
    elsewhere = copy.deepcopy(posed)  # an include is read from any folder: the mesh is not found beside it
    elsewhere.find("string").set("value", str(folder.parent.resolve() / "object.ply"))
    (folder / "pose.xml").write_text(
        include_text("The object as evsdr.calibrate pose placed it.", [elsewhere])
    )
    ET.indent(root, "    ")
    (folder / "scene.xml").write_text(ET.tostring(root, encoding="unicode") + "\n")


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
