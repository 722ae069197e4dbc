"""Files of a load series: read back whole, and by h5py, pandas and pyarrow alone."""

import json
from dataclasses import replace

import h5py
import numpy as np
import pandas as pd
import pytest
from example_motions import motions, strained

from grainmotion.errors import InputError
from grainmotion.io import series_files
from grainmotion.io.series_files import read_series, write_series
from grainmotion.model.motions import Motions
from grainmotion.model.state_fit import StateFit
from grainmotion.sequences.series import Series


def series(make=motions):
    first = make()
    second = replace(first, translations=1.5 * first.translations, fit=StateFit(start_residuals=(0.4, 0.1)))
    return Series.of({"étape #1": first, "two": second}, {"two": 60.0})


@pytest.mark.parametrize("make", [motions, strained])
def test_all_is_read_back(tmp_path, make):
    expected = series(make)
    write_series(tmp_path / "series.h5", expected, settings={"sweeps": 3})
    found = read_series(tmp_path / "series.h5")
    assert found.states == expected.states
    np.testing.assert_array_equal(found.times, expected.times)
    for one, other in zip(found.motions, expected.motions):
        for name, value in vars(other).items():
            if name == "fit":
                assert one.fit.start_residuals == other.fit.start_residuals
            elif name == "strain_covariances" and value is not None:  # the variances alone
                np.testing.assert_allclose(one.strain_sd, other.strain_sd)
            elif isinstance(value, np.ndarray) and value.dtype.kind == "f":
                np.testing.assert_allclose(getattr(one, name), value, rtol=1e-12)
            else:
                np.testing.assert_array_equal(getattr(one, name), value)
    np.testing.assert_allclose(found.increments, expected.increments, rtol=1e-9)


def test_hdf5_by_h5py_alone(tmp_path):
    expected = series()
    write_series(tmp_path / "series.h5", expected, settings={"sweeps": 3})
    with h5py.File(tmp_path / "series.h5") as file:
        assert file.attrs["content"] == "grainmotion load series"
        assert "z up along the rotation axis" in file.attrs["frame"]
        assert file.attrs["version"]
        assert json.loads(file.attrs["settings"]) == {"sweeps": 3}
        names = [name.decode() for name in file["states/name"][()]]
        assert names == ["étape #1", "two"]
        np.testing.assert_array_equal(file["states/residual_extrapolated"][()], [np.nan, 0.1])
        assert file["motions/wz"].shape == (2, 4)
        assert file["motions/wz"].attrs["unit"] == "deg"
        np.testing.assert_allclose(file["motions/wz"][()], np.rad2deg(expected.rotations[..., 2]))
        np.testing.assert_allclose(file["motions/dux"][()], expected.increments[..., 0])
        assert file["motions/status"][0, 2].decode() == "left-field"
        file.visititems(lambda name, item: item.attrs["meaning"] if isinstance(item, h5py.Dataset) else None)


def test_tables_by_pandas_alone(tmp_path):
    expected = series().to_table()
    for suffix in ("csv", "parquet"):
        write_series(tmp_path / f"series.{suffix}", series(), settings={"sweeps": 3})
    csv = pd.read_csv(tmp_path / "series.csv")
    parquet = pd.read_parquet(tmp_path / "series.parquet")
    assert parquet.attrs["units"]["ux"] == "mm"
    assert json.loads(parquet.attrs["settings"]) == {"sweeps": 3}
    assert list(csv.columns) == list(parquet.columns) == list(expected.columns)
    for column in ("ux", "dwz", "sd_duy", "path", "time"):
        np.testing.assert_allclose(csv[column], expected[column], rtol=1e-12)
        np.testing.assert_allclose(parquet[column], expected[column])
    assert list(csv["state"].unique()) == list(parquet["state"].unique()) == ["étape #1", "two"]


def test_a_large_series_of_text_and_numbers_is_compressed(tmp_path):
    n = 3000
    many = Motions.identity(np.arange(1, n + 1), np.zeros((n, 3)))
    write_series(tmp_path / "series.h5", Series.of({"a": many, "b": many}))
    assert (tmp_path / "series.h5").stat().st_size < 700_000
    assert len(read_series(tmp_path / "series.h5").labels) == n


def test_no_grains(tmp_path):
    none = Series.of({"a": Motions.identity(np.zeros(0, int), np.zeros((0, 3)))})
    for suffix in ("h5", "csv", "parquet"):
        write_series(tmp_path / f"series.{suffix}", none)
    assert read_series(tmp_path / "series.h5").translations.shape == (1, 0, 3)


def foreign(path):
    with h5py.File(path, "w") as file:
        file["data"] = np.zeros(3)


def newer(path):
    write_series(path, series())
    with h5py.File(path, "a") as file:
        file.attrs["layout"] = 99


def truncated(path):
    write_series(path, series())
    path.write_bytes(path.read_bytes()[:5000])


def incomplete(path):
    write_series(path, series())
    with h5py.File(path, "a") as file:
        del file["motions/uy"]


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (foreign, "no load series of grainmotion"),
        (newer, "layout 99, of a newer version"),
        (truncated, "truncated or damaged HDF5"),
        (incomplete, "not a readable HDF5"),
        (lambda path: path.write_text("state,index\n"), "HDF5"),
        (lambda path: path.write_text(""), "empty"),
        (lambda path: None, "no such file"),
    ],
)
def test_files_that_are_no_series_are_named(tmp_path, spoil, message):
    path = tmp_path / "series.h5"
    spoil(path)
    with pytest.raises(InputError, match=message) as error:
        read_series(path)
    assert str(path) in str(error.value)


def test_formats_that_cannot_be_are_refused(tmp_path, monkeypatch):
    with pytest.raises(InputError, match="no format of a series"):
        write_series(tmp_path / "series.xlsx", series())
    with pytest.raises(InputError, match="the table alone"):
        read_series(tmp_path / "series.csv")
    monkeypatch.setattr(series_files, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"pip install 'grainmotion\[parquet\]'"):
        write_series(tmp_path / "series.parquet", series())
    assert not list(tmp_path.iterdir())
