"""Arrays survive a page within half a step."""

import base64
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evsdr.page.codec import pack, unpack


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("shape", [(1, 1), (40, 1), (40, 3)])
def test_linear_values_are_within_half_a_step(bits, shape, rng):
    values = rng.normal(size=shape)
    layer = pack(values, bits)
    assert layer.step == pytest.approx(np.ptp(values) / 2 / (2**bits - 1))
    np.testing.assert_allclose(unpack(layer), values, rtol=0, atol=layer.step * (1 + 1e-9) + 1e-12)


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=30))
def test_any_numbers_are_within_half_a_step(values):
    layer = pack(np.array(values))
    assert np.abs(unpack(layer)[:, 0] - values).max() <= layer.step * (1 + 1e-9) + 1e-9


def test_logarithms_are_relative(rng):
    values = np.exp(rng.normal(size=200) * 3)
    layer = pack(values, 8, "log")
    assert np.abs(np.log(unpack(layer)[:, 0] / values)).max() <= layer.step * (1 + 1e-9)


def test_asinh_is_fine_near_zero_and_wide(rng):
    values = np.concatenate([0.01 * rng.normal(size=50), rng.normal(size=50)])
    bound = np.arcsinh(5 / 0.05)
    layer = pack(values, 8, "asinh", 0.05, (-bound, bound))
    off = np.abs(unpack(layer)[:, 0] - values)
    assert off[:50].max() < 0.0015 and (off[50:] < 0.03 * (np.abs(values[50:]) + 0.05)).all()


def test_whole_numbers_are_exact(rng):
    whole = rng.integers(0, 65536, 300)
    np.testing.assert_array_equal(unpack(pack(whole, extremes=(0, 65535)))[:, 0], whole)
    np.testing.assert_array_equal(unpack(pack(whole % 256, bits=8, extremes=(0, 255)))[:, 0], whole % 256)


def test_values_beyond_the_extremes_are_the_extremes():
    np.testing.assert_allclose(unpack(pack([-3.0, 0.5, 9.0], extremes=(0, 1)))[:, 0], [0, 0.5, 1], atol=1e-5)


def test_constants_and_nothing():
    np.testing.assert_array_equal(unpack(pack(np.full(5, 0.3)))[:, 0], np.full(5, 0.3))
    assert unpack(pack(np.zeros((0, 3)))).shape == (0, 3)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_only_finite_values(value):
    with pytest.raises(ValueError, match="finite"):
        pack([0.0, value])


def test_bytes_are_as_documented():
    """Differences from one pixel to the next, channel after channel, low bytes first."""
    layer = pack(np.array([[0, 5], [300, 2]]), extremes=(0, 65535))
    raw = zlib.decompress(base64.b64decode(layer.data))
    assert list(raw) == [0, 300 & 255, 5, 256 - 3, 0, 1, 0, 255]
