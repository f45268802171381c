"""AEDAT4 files."""

import builtins
from dataclasses import replace

import pytest

from evsdr.errors import InputError
from evsdr.rig.aedat import read_aedat
from tests.support.camera_files import assert_same, random_recording
from tests.support.foreign_files import write_aedat


@pytest.fixture
def camera(rng):
    camera = random_recording(rng, n_event=300, n_edge=6, start_us=1_700_000_000_000_000)
    return replace(camera, edges=replace(camera.edges, id=0 * camera.edges.id))


def test_events_and_triggers_come_back(tmp_path, camera):
    pytest.importorskip("aedat")
    write_aedat(tmp_path / "a.aedat4", camera)
    assert_same(read_aedat(tmp_path / "a.aedat4"), camera)


@pytest.mark.parametrize("n_byte", [20, 400, 1000, 4000])
def test_damage_is_one_sentence(tmp_path, camera, n_byte, capfd):
    pytest.importorskip("aedat")
    write_aedat(tmp_path / "a.aedat4", camera)
    (tmp_path / "a.aedat4").write_bytes((tmp_path / "a.aedat4").read_bytes()[:n_byte])
    with pytest.raises(InputError, match="a.aedat4: the AEDAT4 file is damaged or cut short"):
        read_aedat(tmp_path / "a.aedat4")
    assert capfd.readouterr().err == ""


def test_a_file_that_ends_the_process_is_refused(tmp_path, camera, monkeypatch):
    pytest.importorskip("aedat")
    write_aedat(tmp_path / "a.aedat4", camera)
    monkeypatch.setattr("evsdr.rig.aedat.survives", lambda work, seconds: False)
    with pytest.raises(InputError, match="damaged or cut short"):
        read_aedat(tmp_path / "a.aedat4")


def test_without_the_package(tmp_path, camera, monkeypatch):
    def refuse(name, *rest):
        if name == "aedat":
            raise ImportError(name)
        return real(name, *rest)

    real = builtins.__import__
    write_aedat(tmp_path / "a.aedat4", camera)
    monkeypatch.setattr(builtins, "__import__", refuse)
    with pytest.raises(InputError, match=r"not installed; run pip install 'evsdr\[aedat\]'"):
        read_aedat(tmp_path / "a.aedat4")
