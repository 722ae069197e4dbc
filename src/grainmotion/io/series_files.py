"""Files of a load series: ``series.h5``, ``series.csv`` and ``series.parquet``.

``series.h5``, for s states and n grains:

| path | what |
|---|---|
| ``/states/name``, ``/states/time`` | ``(s,)``; time in s since the reference, NaN where not told |
| ``/states/residual_previous``, | ``(s,)``; relative residual at the two starts, the lesser of which was |
| ``/states/residual_extrapolated`` | taken; NaN where there were no two |
| ``/grains/label``, ``/grains/x`` ... | ``(n,)``; label and centre of mass in the reference |
| ``/motions/NAME`` | ``(s, n)``; each other column of the table, in mm and degrees |
| ``/covariances`` | ``(s, n, 6, 6)`` of (ux, uy, uz, wx, wy, wz), mm and **radians**, as in ``motions.h5`` |

Each dataset has the attributes ``unit`` and ``meaning``; the file has ``content``, ``layout``, ``version``, ``frame``
and ``settings`` (JSON).  The CSV is the plain table; in the folder of a run ``datapackage.json`` tells its units.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import h5py
import numpy as np
from numpy.typing import NDArray

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.io.files import atomic_write
from grainmotion.io.hdf5 import opened
from grainmotion.model.motions import Motions
from grainmotion.model.state_fit import StateFit
from grainmotion.sequences.series import Series
from grainmotion.sequences.table import GRAIN_COLUMNS, SERIES_STRAINS, STATE_COLUMNS

if TYPE_CHECKING:
    import pandas as pd

SERIES_CONTENT, SERIES_LAYOUT = "grainmotion load series", 1
_STARTS = ("residual_previous", "residual_extrapolated")
_TEXTS, _FLAGS = ("status", "reason"), ("ok_translation", "ok_rotation")
_COVARIANCES = "of (ux, uy, uz, wx, wy, wz), rotations as increments on the left"


@checked_arguments
def write_series(path: str | Path, series: Series, *, settings: Mapping[str, object] | None = None) -> None:
    """Write a load series, in the format that the file's suffix names.

    Parameters
    ----------
    path : path
        ``.h5`` for all that `read_series` gives back, ``.csv`` or ``.parquet`` for the table alone.
    series : Series
        What is not known is NaN, in the CSV empty.
    settings : mapping, optional
        Plain values to keep with it, as JSON.

    Raises
    ------
    InputError
        If the suffix is another one, the file cannot be written, or Parquet is asked for without pyarrow.

    Examples
    --------
    >>> gm.write_series("series.csv", gm.Series.of({"step-01": motions}))
    """
    path = Path(path)
    writers = {".h5": _write_hdf5, ".csv": _write_csv, ".parquet": _write_parquet}
    if path.suffix.lower() not in writers:
        raise InputError(str(path), f"'{path.suffix}' is no format of a series", f"use one of {', '.join(writers)}")
    if path.suffix.lower() == ".parquet":
        check_parquet(str(path))
    table = series.to_table()
    table.attrs["settings"] = json.dumps({} if settings is None else dict(settings), default=str)
    with atomic_write(path) as temporary:
        writers[path.suffix.lower()](temporary, series, table)


def check_parquet(where: str) -> None:
    """Refuse Parquet where the library that writes it is missing."""
    if find_spec("pyarrow") is None:
        raise InputError(where, "Parquet needs pyarrow, which is not installed", "pip install 'grainmotion[parquet]'")


def _write_csv(path: Path, series: Series, table: pd.DataFrame) -> None:
    table.to_csv(path, index=False)


def _write_parquet(path: Path, series: Series, table: pd.DataFrame) -> None:
    table.to_parquet(path, index=False)  # pandas keeps the attributes of the table in the file's schema


def _write_hdf5(path: Path, series: Series, table: pd.DataFrame) -> None:
    s, n, attrs, text = len(series), len(series.labels), table.attrs, h5py.string_dtype()

    def dataset(name: str, data: NDArray[np.generic], unit: str, meaning: str) -> None:
        options = {"compression": "gzip", "compression_opts": 1, "shuffle": True} if data.size > 1 << 12 else {}
        created = file.create_dataset(name, data=data, dtype=text if unit == "text" else None, **options)
        created.attrs.update(unit=unit, meaning=meaning)

    with h5py.File(path, "w") as file:
        file.attrs.update(content=SERIES_CONTENT, layout=SERIES_LAYOUT, axes="state, grain")
        file.attrs.update({name: attrs[name] for name in ("version", "frame", "settings")})
        dataset("states/name", np.array(series.states, dtype=object), "text", STATE_COLUMNS["state"][1])
        dataset("states/time", series.times, *STATE_COLUMNS["time"])
        starts = np.array([_two_starts(motions.fit) for motions in series.motions])
        for name, column in zip(_STARTS, starts.T, strict=True):
            dataset(f"states/{name}", column, "1", "relative residual at this start; the lesser was taken")
        for name, (unit, meaning) in GRAIN_COLUMNS.items():
            dataset(f"grains/{name}", table[name].to_numpy()[:n], unit, meaning)
        for name in table.columns:
            if name not in STATE_COLUMNS and name not in GRAIN_COLUMNS:
                unit = "text" if name in _TEXTS else attrs["units"].get(name, "1")
                kind = "O" if name in _TEXTS else "u1" if name in _FLAGS else "f8"
                values = table[name].to_numpy().reshape(s, n).astype(kind)
                dataset(f"motions/{name}", values, unit, attrs["meanings"][name])
        covariances = np.array([motions.covariances for motions in series.motions])
        dataset("covariances", covariances, "mm and rad", _COVARIANCES)


def _two_starts(fit: StateFit) -> tuple[float, float]:
    first, second = fit.start_residuals if len(fit.start_residuals) == 2 else (np.nan, np.nan)
    return first, second


@checked_arguments
def read_series(path: str | Path) -> Series:
    """Read a load series from a ``series.h5``.

    Parameters
    ----------
    path : path
        Written by a run, or by `write_series`.

    Returns
    -------
    Series
        In mm and radians.  Of each state's fit as a whole only ``start_residuals`` are known.

    Raises
    ------
    InputError
        If the file is missing, damaged, or no load series.

    Examples
    --------
    >>> gm.write_series("series.h5", gm.Series.of({"step-01": motions}))
    >>> gm.read_series("series.h5").states
    ('step-01',)
    """
    where = str(path)
    if Path(path).suffix.lower() in (".csv", ".parquet"):
        remedy = "read the series.h5 beside it; the table by pandas: pd.read_csv, pd.read_parquet"
        raise InputError(where, "it holds the table alone", remedy)
    with opened(path) as file:
        if str(file.attrs.get("content", "")) != SERIES_CONTENT:
            raise InputError(where, "it is no load series of grainmotion", "give a series.h5")
        layout = int(file.attrs["layout"])
        if layout > SERIES_LAYOUT:
            fact = f"layout {layout}, of a newer version ({file.attrs['version']})"
            raise InputError(where, fact, "install that version or a later one")
        names = tuple(str(name) for name in file["states/name"].asstr()[()])
        motions = tuple(_motions(file, k) for k in range(len(names)))
        return Series(names, motions, file["states/time"][()])


def _motions(file: h5py.File, k: int) -> Motions:
    """The motions of the k-th state."""
    group, grains = file["motions"], file["grains"]

    def vectors(*names: str) -> Float:
        return np.stack([np.asarray(group[name][k], dtype=float) for name in names], axis=-1)

    starts = tuple(float(file[f"states/{name}"][k]) for name in _STARTS)
    strains = strain_covariances = None
    if set(SERIES_STRAINS) <= set(group):
        strains, sd = np.hsplit(vectors(*SERIES_STRAINS), 2)
        strain_covariances = sd[:, :, None] ** 2 * np.eye(6)
    return Motions(
        labels=grains["label"][()].astype(np.int64),
        centers=np.stack([grains[axis][()] for axis in "xyz"], axis=-1),
        translations=vectors("ux", "uy", "uz"),
        rotations=np.deg2rad(vectors("wx", "wy", "wz")),
        covariances=file["covariances"][k],
        statuses=np.array(group["status"].asstr()[k], dtype="<U20"),
        residuals=group["residual"][k],
        iterations=group["iterations"][k].astype(np.int64),
        reasons=tuple(str(reason) for reason in group["reason"].asstr()[k]),
        fit=StateFit(start_residuals=starts if np.isfinite(starts).all() else ()),
        ok_translation=group["ok_translation"][k].astype(bool),
        ok_rotation=group["ok_rotation"][k].astype(bool),
        strains=strains,
        strain_covariances=strain_covariances,
    )
