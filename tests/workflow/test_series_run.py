"""Many states in order: each from the better of two starts, in one table, and one that is added later alone."""

import dataclasses
from collections import Counter

import numpy as np
import pandas as pd
import pytest

from grainmotion.errors import InputError
from grainmotion.experiment.config import read_experiment
from grainmotion.experiment.scan_inputs import ScanInput
from grainmotion.io.geometry_csv import write_geometry
from grainmotion.io.series_files import read_series
from grainmotion.io.tiff import write_tiff
from grainmotion.workflow import reference_stages, tracking_stage
from grainmotion.workflow.run import run
from tiny_experiment import TOML, counts, geometry, sample, write_tiny

STATE = """
[[states]]
name = "{name}"
radiographs = "{name}.tif"
geometry = "views.csv"
{more}
"""
HEAD = TOML[: TOML.index("[[states]]")]
STEP = np.array([0.12, -0.04, 0.06])  # mm a unit of time


def steps(folder, times, more=None):
    """An experiment of states s1, s2, ..., shifted in proportion to these times."""
    write_tiny(folder)
    write_geometry(folder / "views.csv", geometry([0.0, 45.0, 90.0]))
    text = HEAD
    for k, time in enumerate(times, start=1):
        write_tiff(folder / f"s{k}.tif", counts(sample(tuple(time * STEP)), geometry([0.0, 45.0, 90.0])))
        text += STATE.format(name=f"s{k}", more=(more or {}).get(k, ""))
    (folder / "experiment.toml").write_text(text)
    return read_experiment(folder / "experiment.toml")


@pytest.fixture
def work(monkeypatch):
    """Counts of what a run does: states tracked with the number of their starts, reconstructions, scans read."""
    done = Counter()

    def counted(module, name, key):
        original = getattr(module, name)

        def call(*args, **kwargs):
            done[key(*args)] += 1
            return original(*args, **kwargs)

        monkeypatch.setattr(module, name, call)

    counted(tracking_stage, "track_with_residual", lambda grains, scan, starts, *rest: f"from {len(starts)} starts")
    counted(reference_stages, "reconstruct", lambda *args: "reconstruct")
    counted(reference_stages, "segment", lambda *args: "segment")
    counted(ScanInput, "read_with_raw", lambda scan: f"read {scan.key}")
    return done


def test_a_state_added_later_is_tracked_alone(tmp_path, work):
    first = run(steps(tmp_path, [1, 2, 3]))
    assert work["from 1 starts"] == 1
    assert work["from 2 starts"] == 2
    assert work["reconstruct"] == 1
    work.clear()
    second = run(steps(tmp_path, [1, 2, 3, 4]))
    tracking = {key: count for key, count in work.items() if key.startswith(("from", "re", "segment"))}
    assert {key for key in tracking if not key.startswith("read states")} == {"from 2 starts"}
    assert tracking["from 2 starts"] == 1
    tracks = [name for name in second.done if name.endswith("/track")]
    assert tracks == ["s4/track"]
    assert {"s1/track", "s2/track", "s3/track", "s1/residuals"} <= set(second.reused)
    assert not any(name.startswith(("s1/", "s2/", "s3/")) for name in second.done)
    for name in first.motions:
        np.testing.assert_array_equal(first.motions[name].translations, second.motions[name].translations)
    work.clear()
    third = run(steps(tmp_path, [1, 2, 3, 4]))
    assert third.done == ()
    assert not any(key.startswith("from") for key in work)


def test_steady_motion_starts_from_its_extrapolation(tmp_path):
    """Steps of 1.4 voxels: the third state starts where the first two point, nearer than the second."""
    result = run(steps(tmp_path, [1, 2, 3]), until="track")
    residuals = result.motions["s3"].fit.start_residuals
    assert residuals[1] < 0.5 * residuals[0]
    assert result.motions["s1"].fit.start_residuals == ()


def test_a_sample_that_stops_starts_from_the_state_before(tmp_path):
    result = run(steps(tmp_path, [1, 2, 2]), until="track")
    residuals = result.motions["s3"].fit.start_residuals
    assert residuals[0] < 0.5 * residuals[1]


def test_times_scale_the_extrapolation(tmp_path):
    """Unequal steps in proportion to the times: the extrapolation hits the third state only with the times told."""
    times = {k: f"time = {60.0 * t}" for k, t in ((1, 1), (2, 2), (3, 4))}
    told = run(steps(tmp_path / "told", [1, 2, 4], times)).motions["s3"].fit.start_residuals
    not_told = run(steps(tmp_path / "not", [1, 2, 4]), until="track").motions["s3"].fit.start_residuals
    assert told[0] == pytest.approx(not_told[0], rel=1e-6)
    assert told[1] < 0.5 * not_told[1]
    np.testing.assert_array_equal(read_series(tmp_path / "told/results/series.h5").times, [60, 120, 240])


def test_all_states_are_in_one_table(tmp_path):
    experiment = steps(tmp_path, [1, 2, 3])
    output = experiment.tables.output.model_copy(update={"series": ["h5", "csv", "parquet"]})
    tables = experiment.tables.model_copy(update={"output": output})
    result = run(dataclasses.replace(experiment, tables=tables))
    table = pd.read_csv(result.folder / "series.csv")
    assert list(table["state"].unique()) == ["s1", "s2", "s3"]
    for axis, expected in zip("xyz", STEP):
        np.testing.assert_allclose(table[f"du{axis}"], expected, atol=0.01)
    np.testing.assert_allclose(table["uz"].to_numpy().reshape(3, 3), np.outer([1, 2, 3], 3 * [STEP[2]]), atol=0.01)
    np.testing.assert_allclose(table["path"].to_numpy()[-3:], 3 * np.linalg.norm(STEP), rtol=0.05)
    assert len(pd.read_parquet(result.folder / "series.parquet")) == 9
    series = read_series(result.folder / "series.h5")
    np.testing.assert_allclose(series["s2"].translations, result.motions["s2"].translations, atol=1e-12)


def test_a_state_that_is_not_tracked_is_in_the_table_with_its_reason(tmp_path):
    experiment = steps(tmp_path, [1, 2, 3])
    write_tiff(tmp_path / "s2.tif", counts(sample((0.24, -0.08, 0.12)), geometry([0.0, 45.0, 90.0]))[:, ::-1])
    result = run(experiment)
    table = pd.read_csv(result.folder / "series.csv")
    refused = table[table["state"] == "s2"]
    assert set(refused["status"]) == {"not-fitted"}
    assert refused["ux"].isna().all()
    assert refused["reason"].str.contains("was not tracked").all()
    assert table[table["state"] == "s3"]["path"].notna().all()  # across the state that is not known
    assert table[table["state"] == "s3"]["dux"].isna().all()
    assert result.motions["s3"].fit.start_residuals == ()  # one state gives no extrapolation


def test_parquet_without_its_library_is_refused_before_any_work(tmp_path, monkeypatch):
    monkeypatch.setattr("grainmotion.io.series_files.find_spec", lambda name: None)
    write_tiny(tmp_path, TOML + '\n[output]\nseries = ["parquet"]\n')
    with pytest.raises(InputError, match=r"output\.series: Parquet needs pyarrow"):
        run(read_experiment(tmp_path / "experiment.toml"))
    assert not (tmp_path / "results").exists()
