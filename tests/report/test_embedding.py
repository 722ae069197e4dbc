"""Arrays inside the page: the bytes come back, in the order that the page's script expects."""

import base64
import json
import zlib

import numpy as np
import pytest

from grainmotion.report.embedding import embed, embed_json, rounded


def unpacked(embedded) -> np.ndarray:
    """As ``assets/decode.js`` takes arrays from the page."""
    raw = np.frombuffer(zlib.decompress(base64.b64decode(embedded["data"])), np.uint8)
    dtype = np.dtype(embedded["dtype"])
    plain = raw.reshape(dtype.itemsize, -1).T.tobytes()
    return np.frombuffer(plain, dtype).reshape(embedded["shape"])


@pytest.mark.parametrize("dtype", [np.float32, np.int32, np.uint16, np.int8, np.uint8])
def test_arrays_come_back(dtype):
    array = (np.arange(24).reshape(8, 3) * 1.7).astype(dtype)
    back = unpacked(embed(array))
    assert back.dtype == dtype
    np.testing.assert_array_equal(back, array)


def test_doubles_become_singles_and_flags_bytes():
    assert embed(np.array([1.5, np.nan]))["dtype"] == "<f4"
    assert embed(np.array([True, False]))["dtype"] == "<u1"
    assert np.isnan(unpacked(embed(np.array([1.5, np.nan])))[1])
    assert unpacked(embed(np.zeros((0, 3)))).shape == (0, 3)


def test_wide_integers_are_refused():
    with pytest.raises(TypeError, match="4 bytes"):
        embed(np.arange(3))


def test_records_come_back():
    record = {"a": [1, None, "</script>"]}
    packed = embed_json(record)
    assert json.loads(zlib.decompress(base64.b64decode(packed["data"]))) == record
    assert "<" not in packed["data"]


def test_rounding_keeps_the_digits_asked_for_and_what_is_not_finite():
    values = np.array([1.23456789, -4.56789e-7, 0.0, np.nan, np.inf])
    short = rounded(values, 3)
    np.testing.assert_allclose(short[:3], values[:3], rtol=5e-4)
    assert np.isnan(short[3])
    assert np.isinf(short[4])
    assert len(embed(rounded(np.random.default_rng(0).random(4000), 3))["data"]) < 0.7 * 4000 * 4
