"""The script in README does what it says."""

import json
import re

import matplotlib.pyplot as plt
import numpy as np

from tests.conftest import REPOSITORY

SECTION = re.compile(r"^## From Python\n\n```python\n(.*?)```", re.DOTALL | re.MULTILINE)


def test_the_script_simulates_fits_and_plots(tmp_path, monkeypatch, capsys):
    """At a small size; more than 15 lines would be no short script."""
    (script,) = SECTION.findall((REPOSITORY / "README.md").read_text())
    assert len(script.splitlines()) <= 15 and "size=128" in script
    (tmp_path / "scenes").symlink_to(REPOSITORY / "scenes")
    monkeypatch.chdir(tmp_path)
    plt.switch_backend("Agg")
    names = {}
    exec(compile(script.replace("size=128", "size=24"), "README.md", "exec"), names)
    plt.close("all")
    error, why = capsys.readouterr().out.strip().splitlines()
    assert names["found"].summary["warnings"] == [] and "mae_deg" in error and "blocked" in why
    assert (tmp_path / "sphere.png").stat().st_size > 1000
    summary = json.loads((tmp_path / "out" / "sphere" / "summary.json").read_text())
    assert summary["model"]["cast shadows"] == why
    with np.load(tmp_path / "out" / "sphere" / "maps.npz") as maps:
        angle = np.degrees(np.arccos(np.sum(maps["normal"] * names["truth"].normal, axis=-1).clip(-1, 1)))
        assert angle[names["truth"].mask].mean() < 3
