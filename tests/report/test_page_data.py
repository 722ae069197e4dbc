"""The page's data: rows of grains are the same in all states, and what is not there is NaN."""

import json
from dataclasses import replace

import example
import numpy as np
import pytest
from test_embedding import unpacked
from test_series_coding import of_states

from grainmotion.model.motions import Motions, Status
from grainmotion.model.volume import Volume
from grainmotion.report import ReportData, StateReport
from grainmotion.report import page_data as page_data_module
from grainmotion.report.grain_rows import grain_rows
from grainmotion.report.page_data import NO_STATUS, page_data
from grainmotion.report.weak_directions import octahedral, weakest


def of_labels(labels: list[int]) -> StateReport:
    """A state with some of the example's grains."""
    whole = example.motions()
    rows = np.flatnonzero(np.isin(whole.labels, labels))
    fields = ("labels", "centers", "translations", "rotations", "covariances", "statuses", "residuals", "iterations")
    chosen = {name: getattr(whole, name)[rows] for name in fields}
    motions = replace(whole, **chosen, reasons=tuple(whole.reasons[row] for row in rows))
    images = np.zeros((1, 3, 4))
    return StateReport("-".join(map(str, labels)), images, images, motions, 0.1)


def test_grains_that_a_state_lacks_have_rows_without_values():
    data = page_data(ReportData("x", states=(of_labels([1, 31, 51]), of_labels([11, 31]))))
    assert data["grains"]["labels"] == [1, 11, 31, 51]
    residuals = of_states(data["columns"]["residual"])
    for state, residual, present in zip(data["states"], residuals, ([0, 2, 3], [1, 2])):
        status = unpacked(state["status"])
        assert np.flatnonzero(status != NO_STATUS).tolist() == np.flatnonzero(np.isfinite(residual)).tolist() == present
        assert state["grains"] == len(present)


def test_columns_are_those_of_the_motions_in_mm_and_degrees():
    record, motions = page_data(example.data()), example.motions()
    state = record["states"][0]
    columns = {name: of_states(column)[0] for name, column in record["columns"].items()}
    assert state["columns"] == list(columns)
    np.testing.assert_allclose(columns["uy"], motions.translations[:, 1], rtol=0, atol=0.501e-6)  # of a voxel of 0.1
    np.testing.assert_allclose(columns["wz"], np.rad2deg(motions.rotations[:, 2]), rtol=0, atol=0.501e-5)
    np.testing.assert_allclose(columns["residual"], motions.residuals, rtol=1.1e-4)
    np.testing.assert_array_equal(columns["iterations"], motions.iterations)
    sd = np.rad2deg(np.sqrt(motions.covariances[:, 3, 3]))
    np.testing.assert_allclose(columns["sd_wx"], sd, rtol=1.1e-3)
    order = [status.value for status in Status]
    assert [order[k] for k in unpacked(state["status"])] == motions.statuses.tolist()
    np.testing.assert_array_equal(unpacked(state["ok"]["rotation"]), motions.ok_rotation)


def test_strains_are_columns_and_quantities_where_they_were_measured():
    motions = replace(
        example.motions(), strains=np.full((6, 6), -0.0123), strain_covariances=np.tile(4e-6 * np.eye(6), (6, 1, 1))
    )
    images = np.zeros((1, 2, 2))
    data = page_data(ReportData("soft", states=(StateReport("soft", images, images, motions, 0.1), example.state("x"))))
    eyz = of_states(data["columns"]["eyz"])
    assert eyz[0, 2] == pytest.approx(-0.0123, rel=1e-5)
    assert np.isnan(eyz[1]).all()
    assert "eyz" not in data["states"][1]["columns"]
    keys = [quantity["key"] for quantity in data["quantities"]]
    assert {"volume_strain", "exx", "sd_exy"} <= set(keys)
    notes = {quantity["key"]: quantity["note"] for quantity in data["quantities"]}
    assert all(notes[key].startswith("Biot's strain U − I") for key in ("volume_strain", "exx", "exy"))
    assert "half of the change of angle" in notes["eyz"]
    assert "exx" not in [quantity["key"] for quantity in page_data(example.data())["quantities"]]


def test_data_without_values_are_plain_json():
    """No state, no volume; NaN everywhere; no grains."""
    nothing = Motions.identity(np.zeros(0, int), np.zeros((0, 3)))
    still = Motions.identity(np.arange(1, 4), np.full((3, 3), np.nan))
    images = np.full((1, 4, 5), np.nan)
    states = tuple(StateReport(name, images, images, m, 0.1) for name, m in (("a", nothing), ("b", still)))
    for data in (ReportData("reference only"), ReportData("x", states=states[:1]), ReportData("y", states=states)):
        json.dumps(page_data(data), allow_nan=False)


def test_centres_and_diameters_of_a_reference_without_states():
    labels = np.zeros((9, 8, 7), np.int32)
    labels[2:5, 1:4, 3:6] = 7
    labels[8, 7, 6] = 9
    rows = grain_rows(ReportData("r", volume=Volume(labels * 1.0, 0.5, (1.0, 2.0, 3.0)), labels=labels))
    assert rows.labels.tolist() == [7, 9]
    np.testing.assert_allclose(rows.centers[0], np.array([1.0, 2.0, 3.0]) + 0.5 * np.array([1, -1.5, -1]))
    np.testing.assert_allclose(rows.diameters[0], 0.5 * np.cbrt(6 * 27 / np.pi))


def test_weakest_direction_is_that_of_the_largest_variance():
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    covariance = turn @ np.diag([1.0, 4.0, 0.25]) @ turn.T
    direction, largest, least = weakest(np.stack([covariance, np.full((3, 3), np.nan)]))
    assert abs(direction[0] @ turn[:, 1]) == pytest.approx(1)
    assert (largest[0], least[0]) == (pytest.approx(2), pytest.approx(0.5))
    assert np.isnan([*direction[1], largest[1], least[1]]).all()


def test_radiographs_get_the_room_that_the_grains_leave(monkeypatch):
    given = []
    monkeypatch.setattr(page_data_module, "radiograph_records", lambda states, room: given.append(room) or [[], []])
    rest = len(json.dumps(page_data(example.data())))
    monkeypatch.setattr(page_data_module, "PAGE_CHARACTERS", page_data_module.ROUND_CHARACTERS + rest + 2_000_000)
    page_data(example.data())
    monkeypatch.setattr(page_data_module, "PAGE_CHARACTERS", 0)
    page_data(example.data())
    assert given[0] == page_data_module.RADIOGRAPH_CHARACTERS
    assert given[1] == pytest.approx(2_000_000, abs=500)
    assert given[2] == page_data_module.LEAST_RADIOGRAPHS


def test_directions_on_an_octahedron_come_back():
    directions = np.random.default_rng(0).normal(size=(50, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    a, b = octahedral(directions)
    back = np.stack([a, b, 1 - np.abs(a) - np.abs(b)], axis=1)
    back /= np.linalg.norm(back, axis=1)[:, None]
    np.testing.assert_allclose(np.abs((back * directions).sum(axis=1)), 1)


def test_directions_that_are_fixed_do_not_count():
    direction, largest, least = weakest(np.stack([np.diag([4.0, 0.0, 1.0]), np.zeros((3, 3))]))
    np.testing.assert_allclose(direction[0], [1, 0, 0])
    assert (largest[0], least[0], largest[1]) == (2, 1, 0)
    assert np.isnan(least[1])
