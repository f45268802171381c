"""What follows the file that a camera writes."""

import threading
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("websockets")

from evsdr.viewing.watcher import Watcher, watch
from tests.support.grown_files import ball, ball_raw


def test_it_shows_what_the_file_has_gained(tmp_path):
    path = tmp_path / "a.raw"
    watcher = Watcher(path, ball().schedule)
    assert watcher.look()["state"] == "waiting"
    data = ball_raw()
    path.write_bytes(data[: len(data) // 2])
    half = watcher.look()
    path.write_bytes(data)
    whole = watcher.look(ended=True)
    watcher.close()
    assert 0 < half["n_event"] < whole["n_event"] and whole["state"] == "locked" and whole["ended"]
    assert whole["n_event"] > 0.98 * len(ball().events)


def test_a_region_is_shown_alone_and_a_wrong_one_is_told(tmp_path):
    path = tmp_path / "a.raw"
    watchers = [Watcher(path, ball().schedule, region) for region in ((0, 0, 10, 20), (15, 0, 10, 20))]
    path.write_bytes(ball_raw())
    cut, wrong = (watcher.look() for watcher in watchers)
    for watcher in watchers:
        watcher.close()
    assert cut["n_event"] == pytest.approx(np.count_nonzero(ball().events.x < 10), rel=0.02)
    assert cut["picture"]["width"] == 10 and "does not lie inside the sensor" in wrong["words"]


def test_the_last_look_says_so():
    shown, ended = [], threading.Event()
    ended.set()
    server = SimpleNamespace(newest=SimpleNamespace(put=lambda text, ended=False: shown.append(ended)))
    watch(SimpleNamespace(look=lambda ended=False: {}), server, ended)
    assert shown == [True]
