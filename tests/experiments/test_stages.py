"""The benchmark's words are those of as many events, and it compares with the release before."""

import json

import numpy as np

from evsdr.rig.raw import read_raw
from experiments import stages


def test_its_raw_words_hold_its_events(tmp_path):
    path = tmp_path / "a.raw"
    path.write_bytes(stages.RAW_HEADER + stages.raw_words(20_000).tobytes())
    events = read_raw(path).events
    assert len(events) == 20_000 and events.t[-1] > 19_000
    assert np.ptp(events.x) > 1200 and set(events.p) == {0, 1}


def test_the_release_before_is_the_newest_other(tmp_path):
    for version, ratio in (("0.9.0", 1.0), ("0.10.0", 2.0), ("0.11.0", 3.0)):
        told = {"stages": [{"name": "read RAW", "ratio": ratio}]}
        (tmp_path / f"{version}.json").write_text(json.dumps(told))
    assert stages.before_it(tmp_path / "0.11.0.json") == {"read RAW": 2.0}
    assert stages.before_it(tmp_path / "none" / "0.1.0.json") == {}
