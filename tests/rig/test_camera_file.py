"""What every camera's file is checked for, and cut to."""

from dataclasses import replace

import numpy as np
import pytest

from evsdr.errors import InputError, InputWarning
from evsdr.rig.camera_file import Edges, between, check_recording, crop
from evsdr.rig.raw import read_raw
from tests.support.camera_files import random_recording


def test_steps_back_in_time_are_sorted(tmp_path):
    words = np.array([0x8002, 0x0001, 0x2001, 0x8001, 0x2002, 0xA001, 0x8002, 0xA000], "<u2")
    path = tmp_path / "a.raw"
    path.write_bytes(b"% format EVT3;height=8;width=8\n% end\n" + words.tobytes())
    with pytest.warns(
        InputWarning, match="time steps back 1 times, by 4096 us at most; the events are sorted"
    ):
        camera = read_raw(path)
    assert camera.events.t.tolist() == [4096, 8192] and camera.events.x.tolist() == [2, 1]
    words[0] = 0x8010
    path.write_bytes(b"% format EVT3;height=8;width=8\n% end\n" + words.tobytes())
    assert_refused(path, "time steps back by 0.061 s after 0.066 s")


def test_crop(rng):
    camera = random_recording(rng, n_event=5000, n_edge=2)
    cut = crop(camera, 8, 5, 20, 30)
    inside = (
        (camera.events.x // 4 >= 2) & (camera.events.x < 28) & (camera.events.y >= 5) & (camera.events.y < 35)
    )
    np.testing.assert_array_equal(cut.events.x, camera.events.x[inside] - 8)
    np.testing.assert_array_equal(cut.events.y, camera.events.y[inside] - 5)
    np.testing.assert_array_equal(cut.events.t, camera.events.t[inside])
    assert (cut.width, cut.height) == (20, 30)
    for region in ((-1, 0, 5, 5), (0, 0, 65, 5), (0, 44, 5, 5), (3, 3, 0, 5)):
        with pytest.raises(InputError, match=f"--crop {' '.join(map(str, region))} does not lie inside"):
            crop(camera, *region)


def assert_refused(path, sentence):
    with pytest.raises(InputError, match=sentence) as caught:
        read_raw(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ") and message.endswith(".") and "\n" not in message


def test_between_takes_the_first_and_leaves_the_last(rng):
    camera = random_recording(rng, n_event=200, n_edge=2)
    t = camera.events.t
    part = between(camera.events, t[20], t[150])
    assert part.t[0] == t[20] and part.t[-1] < t[150]
    assert len(part) == np.count_nonzero((t >= t[20]) & (t < t[150]))


def test_edges_are_put_in_order_and_no_event_is_refused(tmp_path, rng):
    camera = random_recording(rng, n_event=200, n_edge=8)
    edges = camera.edges
    turned = replace(camera, edges=Edges(edges.p[::-1], edges.t[::-1], edges.id[::-1]))
    checked = check_recording(tmp_path, turned)
    assert (np.diff(checked.edges.t) >= 0).all() and sorted(checked.edges.t) == sorted(edges.t)
    with pytest.raises(InputError, match="it holds no events"):
        check_recording(tmp_path, replace(camera, events=between(camera.events, 0, 0)))
