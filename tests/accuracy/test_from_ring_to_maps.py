"""From ring.json and a camera's file to normals."""

import json

import pytest

import evsdr
from evsdr.commands import convert
from evsdr.errors import InputError
from evsdr.events.record import record, ring_schedule
from evsdr.fitting.simulation import render
from tests.support.camera_files import encode_raw, make_recording
from tests.support.ring_log import LOG, pulses


def test_led_brightness_and_constant_light_go_with_the_recording(recorded, tmp_path):
    """Two LEDs at a quarter and at 0.6, as the ring's log tells; without it normals are wrong by 15 degrees."""
    scene = evsdr.load_scene(recorded / "scene.xml")
    signal, truth = render(scene)
    trim = [1, 0.25, 1, 0.6, 1, 1, 1, 1]
    made = record(signal, 0.05, evsdr.EventPixel().idealised(), ring_schedule(8, trim=trim), 4)
    e, edges = made.events, pulses(made.round_start_us)
    camera = make_recording(e.x, e.y, e.p, e.t, edges.p, edges.t, edges.id, signal.shape[2], signal.shape[1])
    (tmp_path / "a.raw").write_bytes(encode_raw(camera, "EVT3"))
    log = LOG | {"order": list(range(8)), "slot_us": 20_000, "crossfade": 1, "rounds_done": 4}

    def fit(changes):
        (tmp_path / "ring.json").write_text(json.dumps(log | {"trim": trim} | changes))
        assert convert.main([str(tmp_path / "a.raw"), "--ring", str(tmp_path / "ring.json")]) == 0
        path = tmp_path / "events.h5"
        with pytest.warns(evsdr.InputWarning):  # of unknown thresholds, and of LEDs
            found = evsdr.fit(scene, path, evsdr.Settings(preset="fast", thresholds="known"))
        return evsdr.score(found.maps, truth)["mae_deg"]

    assert fit({}) < 1.0
    with pytest.raises(InputError, match="its constant light was off"):
        fit({"constant_light": False})
