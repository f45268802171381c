"""The events of some pixels are those that NumPy finds, in their order."""

import numpy as np

from evsdr.events.chosen import count_events, events_of
from evsdr.records import Events


def test_events_of_some_pixels(rng):
    n, shape = 4000, (7, 11)
    x, y, p = (rng.integers(0, k, n).astype(kind) for k, kind in ((11, "u2"), (7, "u2"), (2, "i1")))
    events, mask = Events(x, y, p, np.arange(n)), rng.random(shape) < 0.4
    kept, inside = events_of(events, mask), mask[y, x]
    for name in "xypt":
        np.testing.assert_array_equal(getattr(kept, name), getattr(events, name)[inside])
        assert getattr(kept, name).dtype == getattr(events, name).dtype
    expected = np.bincount(y.astype(int) * 11 + x, minlength=77).reshape(shape)
    np.testing.assert_array_equal(count_events(events, shape), expected)
