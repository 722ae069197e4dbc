"""Slices of the reference for the page: places, which way is up, grains, and that they fit."""

from __future__ import annotations

import base64
import zlib

import numpy as np
import pytest

from grainmotion.model.volume import Volume
from grainmotion.report.slices import FEWEST_SLICES, GREY_LEVELS, MOST_SLICES, slice_records


def array(stored: dict) -> np.ndarray:
    """An embedded array of bytes or of pairs of shuffled bytes."""
    raw = np.frombuffer(zlib.decompress(base64.b64decode(stored["data"])), np.uint8)
    size = int(stored["dtype"][-1])
    kind = np.dtype(stored["dtype"])
    return np.ascontiguousarray(raw.reshape(size, -1).T).reshape(-1).view(kind).reshape(stored["shape"])


@pytest.fixture(scope="module")
def records() -> dict:
    labels = np.zeros((12, 10, 8), np.int32)
    labels[9:, 1:4, 5:] = 7  # high, at small y and large x
    labels[:3, 6:, :2] = 4
    return slice_records(Volume(labels * 0.1, 0.5, (1.0, 2.0, 3.0)), labels, np.array([4, 7, 9]))


def test_planes_have_their_axes_places_and_ends(records):
    z, y, x = records["planes"]
    assert [(p["axis"], p["across"], p["up"]) for p in (z, y, x)] == [("z", "x", "y"), ("y", "x", "z"), ("x", "y", "z")]
    assert z["positions"] == pytest.approx(3.0 + 0.5 * (np.arange(12) - 5.5))
    assert (x["left"], x["top"]) == (2.0 - 2.5, 3.0 + 3.0)
    assert x["size"] == [5.0, 6.0]
    assert [array(p["grey"]).shape for p in (z, y, x)] == [(12, 10, 8), (10, 12, 8), (8, 12, 10)]


def test_rows_of_grains_lie_where_their_labels_are_upper_axis_upwards(records):
    grains = np.cumsum(array(records["planes"][1]["grains"]), axis=1, dtype=np.uint16)  # across y
    assert grains[2, 0, 7] == 2  # y = 2, uppermost row, large x: the grain of label 7 is the second row
    assert grains[8, -1, 0] == 1
    assert grains[2, -1, 7] == grains[8, 0, 0] == 0
    grey = array(records["planes"][1]["grey"])
    assert grey[2, 0, 7] == GREY_LEVELS - 1
    assert grey[2, -1, 7] == 0


def test_volume_without_labels_has_grey_slices():
    records = slice_records(Volume(np.zeros((4, 5, 6)), 1.0), None, np.zeros(0, int))
    assert all(plane["grains"] is None for plane in records["planes"])
    assert records["range"][1] > records["range"][0]


def test_slices_of_a_large_volume_are_fewer_and_averaged():
    labels = np.zeros((300, 260, 500), np.int32)
    labels[:, :130] = 1
    records = slice_records(Volume(labels.astype(np.float32), 1.0), labels, np.array([1]))
    for plane in records["planes"]:
        assert FEWEST_SLICES <= len(plane["positions"]) <= MOST_SLICES
        assert plane["binning"] > 1
    assert sum(int(np.prod(plane["grey"]["shape"])) for plane in records["planes"]) < 1_600_000
    assert len(str(records)) < 2_000_000
