"""Figures and the picture."""

from dataclasses import replace

import numpy as np
import png

import evsdr
from evsdr.preview.play import error_rows, play_all, prepare, speed_rows
from evsdr.records import Truth
from tests.support.preview_ball import ball_light, ball_normal, ball_recording
from tests.support.watched_files import SIZE


def test_maps_a_picture_and_figures(tmp_path):
    light, told = ball_light(), []
    out = tmp_path / "live.png"
    frames = play_all(ball_recording(), light, 1.0, 10.0, False, out, lambda *given: told.append(given))
    assert told[-1] == ("", 1.0)
    width, height, rows, _ = png.Reader(bytes=out.read_bytes()).read()
    shown = np.array([list(row) for row in rows]).reshape(SIZE, SIZE, 3)
    assert (width, height) == (SIZE, SIZE) and abs(shown[0, 0].astype(int) - (128, 128, 255)).max() <= 1
    assert dict(speed_rows(frames))["maps"] == str(len(frames)) == "5"
    truth = Truth(ball_normal(), np.zeros((SIZE, SIZE, 1)), light.mask)
    assert float(dict(error_rows(frames[-1], truth))["median_deg"]) < 1.5
    assert error_rows(frames[-1], Truth(truth.normal, truth.reflectance, ~light.mask)) == []


def test_a_dimmed_led_counts_as_bright_as_it_was(recorded):
    ring, recording = evsdr.load_scene(recorded / "scene.xml"), evsdr.read_recording(recorded / "events.h5")
    trim = np.array([0.5] + [1.0] * 7, np.float32)
    dimmed = replace(recording, schedule=replace(recording.schedule, trim=trim))
    full, dim = (prepare(ring, r)[1].vector for r in (recording, dimmed))
    np.testing.assert_allclose(dim, trim[:, None] * full, rtol=1e-5)
