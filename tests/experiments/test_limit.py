"""The experiments on the limit of what a recording tells, and on the colour chart."""

import json

import numpy as np
import pytest

from evsdr.limits.bound import Bound, Limit
from evsdr.records import Maps, Truth
from experiments.colour_chart import __main__ as chart_command
from experiments.colour_chart import compute as chart
from experiments.limit import __main__ as experiment
from experiments.limit import compute, summary, tables
from experiments.limit.errors import compare, shares_within


@pytest.fixture(scope="module")
def sphere():
    return compute.render("sphere", 16)


def tilted(angle_deg: np.ndarray) -> np.ndarray:
    """Give normals tilted from the view."""
    angle = np.radians(angle_deg)
    return np.stack([np.sin(angle), np.zeros_like(angle), np.cos(angle)], axis=-1)


def made_up(
    angle_deg, difference, mask=None, normal_sigma_deg=1.0, reflectance_sigma=0.1
) -> tuple[Maps, Truth]:
    """Make maps (1, n) with given errors of normal and reflectance, and their truth."""
    shape = np.shape(angle_deg)
    mask = np.ones(shape, bool) if mask is None else mask
    truth = Truth(tilted(np.zeros(shape)), np.full((*shape, 2), 0.5), np.ones(shape, bool))
    reflectance = truth.reflectance + np.asarray(difference)
    sigma = np.full(shape, normal_sigma_deg), np.full((*shape, 2), reflectance_sigma)
    return Maps(
        tilted(np.asarray(angle_deg, float)), reflectance, mask, *sigma, np.array([450.0, 600.0])
    ), truth


def limit_of(angle, spread) -> Limit:
    """Make a limit with unknown rig, by hand; told, it is half of that."""
    told, unknown = (Bound(f * np.asarray(angle), f * np.asarray(spread)) for f in (0.5, 1.0))
    return Limit(told, unknown, (), None, np.ones(np.shape(angle)))


def test_errors_count_where_they_can_be_small():
    maps, truth = made_up([[1, 3, 50, 7]], [[[0.03, 0.04], [0.01, 0.01], [0.1, 0.1], [0.1, 0.1]]])
    spread = np.full((1, 4, 2), 0.02)
    spread[0, 3, 1] = 0.11  # one band unknown
    figures = compare(maps, truth, limit_of([[2.0, 6.0, 11.0, 1.0]], spread))
    assert figures["angle_known"] == figures["reflectance_known"] == 0.75
    assert figures["angle"] == pytest.approx(np.sqrt(59 / 3))
    assert figures["angle_bound"] == 2 * figures["angle_told"] == pytest.approx(np.sqrt(41 / 3))
    assert figures["angle_ratio"] == pytest.approx(np.sqrt(59 / 41))
    assert figures["angle_typical"] == pytest.approx(0.5 / 0.8326, rel=1e-3)
    assert figures["reflectance"] == pytest.approx(np.sqrt((0.0025 + 0.0002 + 0.02) / 6))
    assert figures["reflectance_ratio"] == pytest.approx(figures["reflectance"] / 0.02)
    assert figures["reflectance_typical"] == pytest.approx(1.75 / 0.6745)
    assert figures["mae_deg"] == pytest.approx(61 / 4)  # over all pixels


def test_ratios_of_own_light_are_means_with_their_errors():
    keys = ("angle_ratio", "angle_typical", "reflectance_ratio", "reflectance_typical")
    rows = [{"scene": "sphere"} | dict.fromkeys(keys, ratio) for ratio in (1.0, 1.1, 1.2)]
    (cells,) = zip(*(column.cells for column in tables.own_table(rows).columns))
    assert cells == ("sphere", *["1.100 +- 0.058"] * 4)


def test_nothing_known_is_no_number():
    maps, truth = made_up([[1, 3]], np.zeros((1, 2, 2)))
    figures = compare(maps, truth, limit_of(np.full((1, 2), 180.0), np.ones((1, 2, 2))))
    assert figures["angle_known"] == 0 and figures["angle"] is None and figures["reflectance_ratio"] is None


def test_shares_within_sigma():
    difference = [[[0.05, 0.15], [0.05, 0.25], [0.05, 0.05], [9, 9]]]
    maps, truth = made_up([[0.5, 1.5, 2.5, 0]], difference, np.array([[True, True, True, False]]))
    shares = shares_within(maps, truth)
    assert shares["known"] == 0.75
    assert (shares["angle_1"], shares["angle_2"]) == pytest.approx((1 / 3, 2 / 3))
    assert (shares["reflectance_1"], shares["reflectance_2"]) == pytest.approx((4 / 6, 5 / 6))


@pytest.mark.filterwarnings("ignore:.*can't tell their scale")  # alone
def test_a_fit_alone_reaches_its_limit(sphere):
    """Each pixel alone stays near its limit, nearest where the light is that of the model; neighbours help beyond it."""
    own, alone, helped = compute.run(sphere, compute.BASE, own=True)
    assert (own["preset"], alone["preset"]) == (compute.OWN, "balanced")
    assert (alone["priors"], helped["priors"]) == (False, True)
    assert alone["angle_known"] > 0.9
    assert 0.8 < own["angle_typical"] < 1.2 and 0.8 < own["reflectance_typical"] < 1.3
    assert 0.8 < alone["angle_ratio"] < 2 and 0.8 < alone["reflectance_ratio"] < 2
    assert alone["angle_bound"] == helped["angle_bound"] > alone["angle_told"]
    assert helped["angle_ratio"] < alone["angle_ratio"]
    assert "angle_1" in alone and "angle_1" not in own


def test_settings_reach_the_recording(sphere):
    quiet = compute.record(sphere, compute.BASE)
    assert (
        compute.record(sphere, compute.Setting(rounds=1)).round_start_us[-1] * 6 == quiet.round_start_us[-1]
    )
    less = compute.record(sphere, compute.Setting(constant_light=0.5))
    assert len(less.events) < 0.5 * len(quiet.events)
    fine = compute.record(sphere, compute.Setting(threshold_on=0.1, threshold_off=0.1))
    assert fine.sensor.contrast_threshold_on == 0.1 and len(fine.events) > 2 * len(quiet.events)
    noisy = compute.record(sphere, compute.Setting(noise=0.3))
    assert len(noisy.events) > 0 and not np.array_equal(noisy.events.t[:100], quiet.events.t[:100])


def test_limit_follows_constant_light_and_sensor(sphere):
    limits = {}
    for setting in (compute.BASE, compute.Setting(constant_light=0.2), compute.EVK4):
        limit = compute.limit(sphere, setting, compute.record(sphere, setting))
        limits[setting] = np.median(limit.told.normal_sigma_deg[sphere.truth.mask])
        assert ("tau" in limit.names) == setting.evk4 and "directions" not in limit.names
    base, bright, evk4 = limits.values()
    assert bright > 2 * base and evk4 < base


def test_too_much_constant_light_leaves_nothing(sphere):
    assert compute.run(sphere, compute.Setting(constant_light=100.0)) == []


def test_light_signal_is_that_of_lit_pixels(sphere):
    assert 0.02 < compute.led_signal(sphere) < 0.5
    masked = sphere.object.signal[:, sphere.truth.mask]
    assert compute.led_signal(sphere) > np.median(masked)  # shadows left out


def test_best_place_and_its_range():
    values = 10.0 ** np.arange(-2, 3)
    errors = np.exp(np.log(values / 2) ** 2)
    place, low, high = summary.best(values, errors)
    assert place == pytest.approx(2)
    assert 0.1 < low < 1 < high < 10
    assert np.interp(np.log(high), np.log(values), np.log(errors)) == pytest.approx(
        np.log(1.1 * errors.min()), abs=0.02
    )
    assert summary.best(values, values)[:2] == pytest.approx((0.01, 0.01))  # at the end of the range
    assert summary.best(values, np.ones(5))[1:] == pytest.approx((0.01, 100))


def test_best_constant_light_is_relative_to_the_leds():
    rows = [
        {"parameter": "constant light", "value": v, "mae_deg": 1 + np.log(v) ** 2, "rmse": v}
        for v in (0.25, 0.5, 1.0, 2.0, 4.0)
    ]
    rows += [{"parameter": "noise", "value": 0.1, "mae_deg": 0.1, "rmse": 0.1}]
    rows = [row | {"scene": "s", "priors": False} for row in rows]
    normals, reflectance = summary.best_constant_light(rows, {"s": 0.5})
    assert normals["what"] == "normals" and normals["relative"] == pytest.approx(2)
    assert reflectance["best"] == pytest.approx(0.25)


def test_median_over_scenes():
    keys = "angle_ratio", "reflectance_ratio", "angle_typical", "reflectance_typical"
    rows = [
        {"sensor": "ideal", "preset": "fast", "priors": priors} | dict.fromkeys(keys, ratio)
        for priors, ratio in ((False, 1.0), (False, 5.0), (False, 2.0), (True, 0.5))
    ]
    alone, helped = summary.median_ratios(rows)
    assert (alone["priors"], alone["scenes"], alone["angle_ratio"]) == (False, 3, 2.0)
    assert helped["reflectance_typical"] == 0.5


def almost(truth: Truth) -> Maps:
    """Give maps that are a little wrong."""
    sigma = np.full(truth.mask.shape, 1.0), np.full(truth.reflectance.shape, 0.1)
    return Maps(truth.normal + (0.02, 0, 0), truth.reflectance + 0.05, truth.mask, *sigma, np.arange(8.0))


def test_command_writes_figures_and_picture(sphere, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(experiment, "SCENES", ("sphere",))
    monkeypatch.setattr(compute, "render", lambda *_: sphere)
    cases = [(v, compute.Setting(constant_light=v)) for v in (0.05, 0.2, 100.0)]
    monkeypatch.setattr(compute, "SWEEPS", {"constant light": cases})
    monkeypatch.setattr(compute, "recover", lambda rendered, *_: almost(rendered.truth))
    assert experiment.main(["--out", str(tmp_path / "out"), "--size", "16"]) == 0
    out = capsys.readouterr().out
    assert "sphere, constant light" in out and "Best constant light" in out
    result = json.loads((tmp_path / "out" / "limit.json").read_text())
    assert [row["value"] for row in result["sweeps"]] == [0.05, 0.05, 0.2, 0.2]
    assert len(result["base"]) == 1 + 4 + 2 and result["median ratio"][0]["scenes"] == 1
    angle = "{:.2f} · {:.2f} · {:.2f} · {:.2f} |"
    alone, helped = (row for row in result["sweeps"] if row["value"] == 0.2)
    cell = angle.format(alone["angle"], helped["angle"], alone["angle_bound"], alone["angle_ratio"])
    assert f"| constant light 0.2 | {cell}" in (tmp_path / "out" / "limit.md").read_text()
    assert (tmp_path / "out" / "limit.png").stat().st_size > 20_000


def drawn_chart(swapped: bool = False) -> Truth:
    """Draw a chart of 4 x 6 patches, 8 pixels wide, 2 apart; patch i has reflectance (i + 1) / 30."""
    value = np.full((42, 62), 0.01)
    for i in range(24):
        row, column = divmod(i, 6)
        value[2 + 10 * row :, 2 + 10 * column :][:8, :8] = (24 - i if swapped else i + 1) / 30
    normal, mask = np.broadcast_to([0.0, 0.0, 1.0], (42, 62, 3)), np.zeros((42, 62), bool)
    mask[1:-1, 1:-1] = True
    return Truth(normal, np.stack([value, value], axis=-1), mask)


def test_patches_are_found_row_by_row():
    truth = drawn_chart()
    patch = chart.find_patches(truth)
    np.testing.assert_array_equal(np.bincount(patch[patch >= 0]), np.full(24, 36))  # without their rims
    for i in range(24):
        np.testing.assert_allclose(truth.reflectance[patch == i], (i + 1) / 30)
    np.testing.assert_array_equal(patch, chart.find_patches(drawn_chart(swapped=True)))


def test_a_chart_too_small_is_refused():
    truth = drawn_chart()
    small = Truth(truth.normal[:20], truth.reflectance[:20], truth.mask[:20])
    with pytest.raises(ValueError, match="12 patches"):
        chart.find_patches(small)


def test_errors_of_patches():
    truth = drawn_chart()
    patch = chart.find_patches(truth)
    reflectance, n_event = truth.reflectance.copy(), np.zeros(patch.shape, int)
    odd = np.indices(patch.shape).sum(axis=0) % 2 == 1
    reflectance[odd & (patch == 3)] += 0.1
    reflectance[~odd & (patch == 3)] -= 0.1  # cancels in the mean
    reflectance[patch == 5] += (0.03, 0.04)
    n_event[patch == 5] = 7
    rest = np.zeros(patch.shape), np.zeros(reflectance.shape), np.array([450.0, 600.0])
    maps = Maps(truth.normal, reflectance, patch != 4, *rest)
    errors = chart.patch_errors(chart.Chart(maps, truth, n_event, {}), patch)
    assert len(errors) == 24
    assert errors[3]["rmse_of_mean"] == pytest.approx(0, abs=1e-12) and errors[3]["rmse"] == pytest.approx(
        0.1
    )
    assert (errors[5]["rmse"], errors[5]["rmse_of_mean"]) == pytest.approx((np.sqrt(0.00125),) * 2)
    assert errors[5]["events"] == 7 and errors[5]["sam_deg"] > 0.5 > errors[3]["sam_deg"]
    assert errors[4]["known"] == 0 and errors[6]["known"] == 1
    assert chart_command.table("t", errors).row_count == 25


def test_dark_slots_come_before_every_third_led():
    assert chart.order_with_pauses(5) == (-1, 0, 1, 2, -1, 3, 4)
