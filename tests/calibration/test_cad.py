"""A posed CAD model in a scene, with its truth, as the command writes them."""

from pathlib import Path

import numpy as np

from evsdr.commands import calibrate
from evsdr.light.ground_truth import surface_maps
from evsdr.light.scene import load_scene
from evsdr.metrics import angular_error_deg

SCENES = Path(__file__).resolve().parents[2] / "scenes"


def test_pose_command_renders_the_truth(blob, points, tmp_path, capsys):
    _, mask, truth, mesh, _ = blob
    np.save(tmp_path / "mask.npy", mask)
    moved = mesh.copy().apply_scale(100).apply_translation([300, 0, -50])  # a model in its own unit and place
    moved.export(tmp_path / "model.stl")
    pixel, point = points[0], 100 * points[1] + [300, 0, -50]
    rows = [",".join(f"{v:.6f}" for v in (*p, *x)) for p, x in zip(pixel, point)]
    (tmp_path / "points.csv").write_text("x_pixel,y_pixel,X,Y,Z\n" + "\n".join(rows) + "\n")
    arguments = [
        "pose",
        str(SCENES / "blob.xml"),
        str(tmp_path / "model.stl"),
        "-D",
        "size=96",
        "--unit",
        "0.01",
    ]
    arguments += ["--points", str(tmp_path / "points.csv"), "--spp", "4"]
    out = tmp_path / "out"
    assert calibrate.main([*arguments, "--mask", str(tmp_path / "mask.npy"), "--out", str(out)]) == 0
    made = np.load(out / "truth.npz")
    both = made["mask"] & truth.mask
    assert both.sum() > 0.97 * truth.mask.sum()
    assert np.median(angular_error_deg(made["normal"][both], truth.normal[both])) < 0.7
    text = (SCENES / "blob.xml").read_text()
    start, end = text.index("<shape"), text.index("</shape>") + len("</shape>")
    text = text[:start] + '<include filename="out/pose.xml"/>' + text[end:]
    text = text.replace('filename="camera', f'filename="{SCENES}/camera').replace(
        '="ring24', f'="{SCENES}/ring24'
    )
    text = text.replace('<include filename="bases_$bases.xml"/>', '<bsdf type="diffuse" id="surface"/>')
    (tmp_path / "scene.xml").write_text(text)
    again = surface_maps(load_scene(tmp_path / "scene.xml", {"size": "96"}), 4)
    np.testing.assert_allclose(again.normal[both], made["normal"][both], atol=1e-4)
    (tmp_path / "points.csv").write_text("\n".join(["1,2,0,0,0", "2,3,1,1,1", "3,4,2,2,2", "4,5,3,3,3"]))
    for extra, says in (([], "lie on one line"), (["--unit", "0"], "--unit must be finite")):
        assert calibrate.main([*arguments, *extra, "--out", str(tmp_path / "no")]) == 2
        assert says in capsys.readouterr().err
    assert not (tmp_path / "no").exists()
