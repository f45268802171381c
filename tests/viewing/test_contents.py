"""What the page holds: all events if they are few, whole rounds or some pixels if they are many."""

import numpy as np

from evsdr.page.codec import Layer, unpack
from evsdr.viewing.contents import STORED, contents
from evsdr.viewing.look import look_at
from tests.support.watched_files import N_LED, recorded, watched


def layer(shown, name):
    return np.round(unpack(Layer(**shown["layers"][name]))[:, 0]).astype(int)


def test_of_many_events_whole_rounds_are_kept():
    recording = recorded()
    look = look_at(watched(recording))
    whole = contents(look)
    assert layer(whole, "count").sum() == len(recording.events)
    assert whole["stride"] == 1 and whole["n_stored"] == 400
    some = contents(look, most_events=len(recording.events) * 2 // 3)
    assert some["window_us"] + recording.events.t[0] == 2 * N_LED * 20_000
    assert layer(some, "count").sum() == np.count_nonzero(recording.events.t < 2 * N_LED * 20_000)
    np.testing.assert_array_equal(layer(some, "on"), layer(whole, "on"))


def test_of_a_long_round_some_pixels_are_kept():
    look = look_at(watched(recorded()))
    few = contents(look, most_events=800)
    assert few["stride"] > 1
    stored = (layer(few, "state") & STORED > 0).reshape(20, 20)
    assert stored[:: few["stride"], :: few["stride"]].all()
    assert stored.sum() == len(range(0, 20, few["stride"])) ** 2
    assert 0 < layer(few, "count").sum() < 1200
