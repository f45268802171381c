"""The rig told wrong: what is true against what is told, and how a table shows it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from evsdr.solve.shared.rig import across
from experiments.shared import pixels
from experiments.shared.__main__ import error_table, values_table
from experiments.shared.compute import (
    ALL_WRONG,
    CASES,
    Case,
    Errors,
    Result,
    Watched,
    Wrong,
    opened,
    record,
    told_rig,
    told_wrong,
)
from tests.support.foreign_pixel import ForeignPixel
from tests.support.foreign_recordings import Report

SIZE = 8


def light_vectors(ring):
    """Give the vector (n_led, 3) from the surface to each LED, as long as its power."""
    from evsdr.light.tracing import light_at_centre

    return light_at_centre(ring)


def test_what_is_true_turns_what_is_told_into_what_is():
    case = Case("all", wrong=ALL_WRONG)
    real, rig = opened("sphere", SIZE, False), told_rig(case, "sphere", SIZE, 3)
    is_, told = light_vectors(real), light_vectors(rig.scene)
    length, told_length = (np.linalg.norm(v, axis=1, keepdims=True) for v in (is_, told))
    power = np.log(length / told_length).ravel()
    np.testing.assert_allclose(power, rig.log_power, atol=1e-4)
    band = real.leds.band
    np.testing.assert_array_equal(rig.scene.leds.band, band)
    np.testing.assert_allclose(np.bincount(band, rig.log_power), 0, atol=1e-12)
    for here, there, tilt in zip(told / told_length, is_ / length, np.radians(rig.tilt_deg)):
        moved = here + tilt @ across(here)
        np.testing.assert_allclose(moved / np.linalg.norm(moved), there, atol=1e-5)
    assert np.degrees(np.sqrt(np.mean((told / told_length - is_ / length) ** 2) * 3 / 2)) == pytest.approx(
        1, rel=0.3
    )


def test_a_white_ring_is_one_band():
    assert opened("sphere", SIZE, True).leds.n_band == 1
    assert opened("sphere", SIZE, False).leds.n_band == 8


def test_the_recording_is_told_wrong_and_late():
    recording, pixelwise, _ = record(Watched(rounds=1), "sphere", SIZE, 0)
    given = told_wrong(recording, ALL_WRONG)
    np.testing.assert_array_equal(given.events.t, recording.events.t + 50)
    np.testing.assert_array_equal(given.round_start_us, recording.round_start_us)
    assert given.sensor.refractory_us == pytest.approx(1.15 * 52)
    assert given.sensor.contrast_threshold_off == pytest.approx(0.85 * 0.3795)
    assert pixelwise.sensor.contrast_threshold_on.shape == (SIZE, SIZE)
    assert told_wrong(recording, Wrong()).sensor == recording.sensor


def test_cases_have_names_of_their_own():
    assert len({case.name for case in CASES}) == len(CASES)
    assert len({replace(case, name="") for case in CASES}) == len(CASES)


def test_rows_are_means_over_recordings():
    good = Errors(1.0, 0.8, 0.5, 0.02, np.array([0.4, 0.8, 0.9]), np.array([0.5, 0.7, 0.8]), 2.0, 0.25)
    bad = replace(good, mae_deg=3.0, rmse=0.04)
    results = [
        Result(bad, bad, good, good, {"tau": (tau, 53.0, z), "powers": (0.01, 0.1, 1.0)}, steps)
        for tau, z, steps in ((50.0, -3.0, 4), (54.0, 1.0, 8))
    ]
    (cells,) = zip(*(column.cells for column in error_table({"a": results}).columns))
    assert cells[:7] == (
        "a", "3.000 0.0400", "3.000 0.0400", "1.000 0.0200", "1.000 0.0200", "3.00 2.00", "3.00 2.00"
    )  # fmt: skip
    assert cells[7:] == (
        "0.800 0.800 0.800",
        "0.500 0.500 0.500",
        "40 80 90",
        "50 70 80",
        "2.0",
        "2.0",
        "25 %",
    )
    (cells,) = zip(*(column.cells for column in values_table({"a": results}).columns))
    assert cells[1] == "52 | 53 (-1.0)" and cells[2] == "" and cells[-1] == "6"
    assert cells[8] == "1 % | 10 % (+1.0)"


def test_a_row_of_a_foreign_pixel():
    """Means over its recordings; what it shares is of the first, and no lag is written where none is modelled."""
    rig = SimpleNamespace(dark=0.0, noise=0.0, log_threshold=np.log([0.99, 1.01]))
    sigma = SimpleNamespace(dark=0.1, noise=0.1, log_threshold=np.array([0.01, 0.02]))
    answer = SimpleNamespace(inferred=SimpleNamespace(rig=rig, sigma=sigma), us=lambda _: (50.0, 3.0))

    def cells(lags):
        powers, lag = SimpleNamespace(answer=answer), SimpleNamespace(modelled=lags)
        fit = SimpleNamespace(decisions={"LED powers": powers, "photoreceptor lag": lag})
        ours = [
            Report(angle, 0.02, 1.01, np.array([0.6, 0.9, 1.0]), np.array([0.5, 0.8, 0.9]), 1.0, fit)
            for angle in (0.2, 0.4)
        ]
        return pixels.row(12.0, ours, ours, ForeignPixel(tau_us=53.0))

    assert cells(False) == (
        "12", "0.30", "0.0200", "1.010", "60 90 100", "50 80 90", "0.30", "0.0200",
        "", "", "", "0.99 | 1 +- 0.01", "1.01 | 1 +- 0.02",
    )  # fmt: skip
    assert cells(True)[8] == "50 | 53 +- 3"
