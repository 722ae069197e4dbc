"""Radiographs for the page: which way is up, what they hold, and that they fit."""

from __future__ import annotations

import base64
import zlib
from dataclasses import replace

import numpy as np
import pytest
import radiographs_example

from grainmotion.report.data import StateReport
from grainmotion.report.image_coding import Coding
from grainmotion.report.radiographs import radiograph_records


def images(record: dict) -> tuple[np.ndarray, np.ndarray]:
    """Simulated and residual radiograph of a record, as the page has them."""
    coding, found = Coding(**record["coding"]), []
    for name in ("simulated", "residual"):
        stored = record["images"][name]
        found.append(
            np.frombuffer(zlib.decompress(base64.b64decode(stored["data"])), np.uint8).reshape(stored["shape"])
        )
    return coding.simulated_values(np.cumsum(found[0], axis=0, dtype=np.uint8)), coding.residual_values(found[1])


def characters(records: list[list[dict]]) -> int:
    """Of all images in these records."""
    kept = [view["images"] for views in records for view in views if view["images"] is not None]
    return sum(len(image["data"]) for of_view in kept for image in of_view.values())


def with_panel(state: StateReport, shape: tuple[int, int]) -> StateReport:
    """The state with noise of another size as its radiographs."""
    noise = np.random.default_rng(0).normal(0, 0.1, (2, *shape))
    return replace(state, measured=noise, simulated=0 * noise, residual=noise, geometry=None)


@pytest.mark.parametrize("first_row", ["bottom", "top"])
def test_uppermost_row_comes_first(first_row):
    state = radiographs_example.report(first_row=first_row).states[1]
    record = radiograph_records([state])[0][0]
    simulated, residual = images(record)
    upwards = slice(None, None, -1 if first_row == "bottom" else 1)
    masked = np.isnan(state.measured[0][upwards])
    np.testing.assert_array_equal(np.isnan(simulated), masked)
    step = record["coding"]["step"]
    np.testing.assert_allclose(simulated[~masked], state.simulated[0][upwards][~masked], atol=0.51 * step)
    measured = simulated + residual
    np.testing.assert_allclose(measured[~masked], state.measured[0][upwards][~masked], atol=0.51 * step + 0.005)


def test_record_holds_geometry_size_and_misfit():
    state = radiographs_example.report().states[1]
    record = radiograph_records([state])[0][1]
    assert (record["rows"], record["columns"], record["binning"]) == (*radiographs_example.PANEL, 1)
    assert record["geometry"]["v"] == pytest.approx(state.geometry.v[1])
    assert record["rms"] == pytest.approx(0.02, rel=0.05)
    assert record["percent"] == pytest.approx(100 * 0.02 / np.sqrt(np.mean(state.measured[1] ** 2)), rel=0.05)
    assert record["range"][0] <= 0
    assert record["range"][1] == pytest.approx(np.quantile(state.measured[1], 0.999), rel=0.1)


def test_large_radiographs_are_averaged_until_they_fit():
    state = with_panel(radiographs_example.report().states[1], (300, 410))
    assert radiograph_records([state])[0][0]["binning"] == 1
    records = radiograph_records([state] * 3, 150_000)
    assert characters(records) <= 150_000
    assert characters(records) > 50_000
    assert records[2][1]["binning"] == 3
    residual = images(records[0][0])[1]
    assert residual.shape == (100, 137)
    mean = state.residual[0][::-1][:3, :3].mean()
    assert residual[0, 0] == pytest.approx(mean, abs=0.2 * 0.1 / 3)


def test_many_states_keep_those_that_are_worth_it():
    """Where all of them would be a few pixels each, some states keep radiographs on which something is to be seen."""
    state = with_panel(radiographs_example.report().states[1], (90, 90))
    records = radiograph_records([state] * 40, 60_000)
    kept = [k for k, views in enumerate(records) if views[0]["images"] is not None]
    assert characters(records) <= 60_000
    assert 5 < len(kept) < 25
    assert kept[-1] == 39
    assert all(records[k][0]["binning"] <= 2 for k in kept)
    assert records[1][0]["rms"] is not None


def test_views_without_a_value_are_no_fault():
    state = with_panel(radiographs_example.report().states[1], (20, 20))
    empty = replace(state, measured=np.full((2, 20, 20), np.nan), residual=np.full((2, 20, 20), np.nan))
    record = radiograph_records([empty])[0][0]
    assert record["rms"] is None
    assert record["percent"] is None
    assert np.isnan(images(record)[1]).all()
