"""Triggers in a file of their own."""

import numpy as np
import pytest

from evsdr.errors import InputError
from evsdr.rig.side_triggers import read_triggers
from tests.support.foreign_files import write_eventps_triggers

TIMES = [1000, 329_700, 658_400]


def test_both_kinds(tmp_path):
    path = tmp_path / "triggers"
    write_eventps_triggers(path, TIMES)
    assert read_triggers(path).t.tolist() == TIMES
    path.write_bytes((1e-6 * np.array(TIMES)).astype("<f4").tobytes())
    assert read_triggers(path).t.tolist() == TIMES
    path.write_text("# us\n" + "\n".join(map(str, TIMES)))
    edges = read_triggers(path)
    assert (edges.t.tolist(), edges.p.tolist(), edges.id.tolist()) == (TIMES, [1] * 3, [0] * 3)


@pytest.mark.parametrize(
    "data, sentence",
    [
        (None, "there is no such file"),
        (b"\n", "its 0 times|write a time"),
        (b"3\n2\n", "do not grow"),
        (b"1\nx\n", "do not grow|neither text"),
        (b"1,2\n3,4\n", "its lines hold 2 numbers"),
        (np.float32([1, np.inf]).tobytes(), "are not finite"),
        (bytes(3), "neither text nor a list of float32"),
        (b"\xfd7zXZ\x00 and so on", "damaged or cut short"),
    ],
)
def test_other_content(tmp_path, data, sentence):
    if data is not None:
        (tmp_path / "a").write_bytes(data)
    with pytest.raises(InputError, match=sentence):
        read_triggers(tmp_path / "a")
