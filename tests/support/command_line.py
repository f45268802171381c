"""What runs the commands as a user does, and spoils what they read."""

import json
import re

import h5py
import numpy as np
import pytest

from evsdr.commands import fit, simulate

N_LED, N_BAND = 8, 2


class Commands:
    """Runs commands in a folder with its scene.xml and events.h5, and reads what they print."""

    def __init__(self, folder, capsys):
        self.folder, self.capsys = folder, capsys

    def run(self, main, *argv):
        """Give exit status, standard output and standard error."""
        self.capsys.readouterr()
        status = main([str(word) for word in argv])
        return status, *self.capsys.readouterr()

    def refused(self, main, *argv):
        """Run on bad input, check that nothing but one sentence comes of it, and give the sentence."""
        before = contents(self.folder)
        status, out, err = self.run(main, *argv)
        *warned, sentence = err.splitlines()
        assert status == 2
        assert out == ""
        assert all(line.startswith("warning: ") for line in warned)
        assert re.fullmatch(r"error: \S.*[^.]\.", sentence)
        assert contents(self.folder) == before
        return sentence

    def fit(self, *argv, scene="scene.xml", events="events.h5", out="out"):
        out = ["--out", self.folder / out] if out else []
        quick = () if "--preset" in argv else ("--preset", "fast", "--shared", "none")
        return self.run(fit.main, self.folder / scene, self.folder / events, *quick, *out, *argv)

    def fit_refused(self, *argv, scene="scene.xml", events="events.h5", out="out"):
        return self.refused(
            fit.main, self.folder / scene, self.folder / events, "--out", self.folder / out, *argv
        )

    def simulate(self, *argv, scene="scene.xml", ideal=("--ideal",), out="."):
        return self.run(simulate.main, self.folder / scene, "--out", self.folder / out, *ideal, *argv)

    def results(self, *argv, status=0, **names):
        """Fit, check exit status and what holds for all results, and give maps and summary."""
        given, out, err = self.fit(*argv, **names)
        assert given == status, err
        folder = self.folder / names.get("out", "out")
        text = (folder / "summary.json").read_text()
        summary = json.loads(text, parse_constant=pytest.fail)  # called on NaN and infinity
        said = [
            line for line in err.splitlines() if not line.startswith("fit: ")
        ]  # how far it is, if it takes long
        assert said == [f"warning: {message}" for message in summary["warnings"]]
        with np.load(folder / "maps.npz") as file:
            maps = {name: file[name] for name in file.files}
        check_maps(maps)
        verdict = summary["verdict"].partition(": ")[0]
        assert verdict == "contradicted" if status else verdict in ("trustworthy", "doubtful")
        assert re.search(rf"verdict\W+{verdict}\b", out)
        return maps, summary


def contents(folder):
    """List what lies in a folder, with size and time of each file."""
    return {
        path: path.is_file() and (path.stat().st_size, path.stat().st_mtime_ns)
        for path in sorted(folder.rglob("*"))
    }


def check_maps(maps):
    """Check what holds for the maps of any recording."""
    height, width = maps["mask"].shape
    n_band = len(maps["band_wavelength_nm"])
    assert {name: (array.shape, array.dtype.str) for name, array in maps.items()} == {
        "normal": ((height, width, 3), "<f4"),
        "reflectance": ((height, width, n_band), "<f4"),
        "mask": ((height, width), "|b1"),
        "mask_reflectance": ((height, width), "|b1"),
        "normal_sigma_deg": ((height, width), "<f4"),
        "reflectance_sigma": ((height, width, n_band), "<f4"),
        "band_wavelength_nm": ((n_band,), "<f4"),
    }
    mask = maps["mask"]
    assert all(np.isfinite(array).all() for array in maps.values())
    np.testing.assert_allclose(np.linalg.norm(maps["normal"], axis=-1), 1, atol=1e-5)
    assert maps["normal"][..., 2].min() > 0
    assert maps["reflectance"].min() >= 0
    assert (maps["normal_sigma_deg"][~mask] == 180).all() and (maps["reflectance_sigma"][~mask] == 1).all()
    assert (maps["normal_sigma_deg"][mask] < 90).all() and (maps["normal_sigma_deg"] > 0).all()
    assert not (maps["mask_reflectance"] & ~mask).any()
    assert (maps["reflectance_sigma"] > 0).all() and (maps["reflectance_sigma"] <= 1).all()


def change(folder, group=None, **attributes):
    """Set attributes of events.h5, or remove those that are None."""
    with h5py.File(folder / "events.h5", "r+") as file:
        item = file[group] if group else file
        for name, value in attributes.items():
            if value is None:
                del item.attrs[name]
            else:
                item.attrs[name] = value


def replace(folder, name, table):
    """Replace a dataset of events.h5; None removes it."""
    with h5py.File(folder / "events.h5", "r+") as file:
        del file[name]
        if table is not None:
            file[name] = table


def read(folder, name):
    with h5py.File(folder / "events.h5") as file:
        return file[name][()]
