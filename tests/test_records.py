"""Records stay as they are made."""

from dataclasses import FrozenInstanceError, fields

import numpy as np
import pytest

from evsdr import records

RECORDS = [v for v in vars(records).values() if isinstance(v, type) and v.__module__ == records.__name__]


@pytest.mark.parametrize("record", RECORDS)
def test_records_are_frozen_and_documented(record):
    value = record(*(None for _ in fields(record)))
    for field in fields(record):
        with pytest.raises(FrozenInstanceError):
            setattr(value, field.name, 1)
    assert record.__doc__ and not record.__doc__.startswith(f"{record.__name__}(")


def test_events_are_as_many_as_their_times():
    assert len(records.Events(*np.zeros((4, 7), int))) == 7
