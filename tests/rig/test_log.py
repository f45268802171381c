"""ring.json: what is written comes back, and what can't be used is refused."""

import json

import pytest

from evsdr.errors import InputError
from evsdr.rig.log import RunLog, read_ring_log, write_ring_log
from tests.support.ring_log import LOG


@pytest.mark.parametrize(
    "changes, sentence",
    [
        ({"format": "other"}, "its format is not"),
        ({"version": 2}, "its version is 2"),
        ({"order": []}, "order must list"),
        ({"order": [0, 1.5]}, "order must list"),
        ({"order": [0, True]}, "order must list"),
        ({"order": [-1, -1]}, "order must list"),
        ({"order": [0, 256]}, "order must list"),
        ({"order": "01"}, "order must list"),
        ({"slot_us": None}, "slot_us must be a finite number"),
        ({"slot_us": float("nan")}, "slot_us must be a finite number"),
        ({"slot_us": 0}, "slot_us is 0"),
        ({"crossfade": 1.5}, "crossfade is 1.5"),
        ({"rounds_done": 0, "ended": "stopped"}, "rounds_done is 0, so no round was completed"),
        ({"rounds_done": 2.5}, "rounds_done is 2.5"),
        ({"trim": [1.0, 0.5]}, "trim must list"),
        ({"trim": [1.0, 0.5, 1.01]}, "trim must list"),
        ({"trim": [1.0, 0.5, True]}, "trim must list"),
        ({"constant_light": 1}, "constant_light is 1"),
    ],
)
def test_wrong_ring_log(tmp_path, changes, sentence):
    path = tmp_path / "ring.json"
    path.write_text(json.dumps(LOG | changes))
    with pytest.raises(InputError, match=f"ring.json: {sentence}"):
        read_ring_log(path)


@pytest.mark.parametrize("text, sentence", [("", "not JSON"), ("[1]", "its format"), ("\xff{", "not JSON")])
def test_ring_log_of_another_kind(tmp_path, text, sentence):
    path = tmp_path / "ring.json"
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(InputError, match=sentence):
        read_ring_log(path)


def test_what_a_run_did_comes_back(tmp_path):
    names = ("order", "slot_us", "crossfade", "rounds", "constant_light")
    settings = {name: LOG[name] for name in names} | {"trim": [0.5, 1, 0]}
    run = RunLog(
        "1.0", settings, "2025-05-01T10:00:00Z", rounds_done=5, lines=[(0.12345, "armed")], ended="done"
    )
    write_ring_log(tmp_path / "ring.json", run)
    written = json.loads((tmp_path / "ring.json").read_text())
    assert list(written)[:3] == ["format", "version", "firmware"] and written["log"] == [[0.1235, "armed"]]
    log = read_ring_log(tmp_path / "ring.json")
    assert (log.order.tolist(), log.slot_us, log.crossfade) == (
        LOG["order"],
        LOG["slot_us"],
        LOG["crossfade"],
    )
    assert (log.n_round, log.ended, log.round_us) == (5, "done", 10_000)
    assert log.trim.tolist() == [0.5, 1, 0] and log.constant_light is True


def test_a_run_without_a_complete_round_is_refused(tmp_path):
    write_ring_log(
        tmp_path / "ring.json",
        RunLog("1.0", {"order": [0], "slot_us": 1e3, "crossfade": 0}, "", ended="stop"),
    )
    with pytest.raises(InputError, match="rounds_done is 0"):
        read_ring_log(tmp_path / "ring.json")
