"""Geometry as CSV: one row a view, columns sx,sy,sz,dx,dy,dz,ux,uy,uz,vx,vy,vz in any order, all in mm."""

from __future__ import annotations

from io import StringIO
from pathlib import Path

import numpy as np

from grainmotion._typing import Beam
from grainmotion.errors import InputError
from grainmotion.io.files import atomic_write
from grainmotion.io.text import read_text
from grainmotion.model.geometry import VIEW_COLUMNS, Geometry

CSV_HEADER = ",".join(VIEW_COLUMNS)


def read_geometry(path: str | Path, shape: tuple[int, int], beam: Beam = "cone") -> Geometry:
    """Read the views of a scan; other columns and lines that begin with ``#`` are ignored.

    The file does not hold the panel's ``shape`` (rows, columns), nor whether sx,sy,sz is the source's position or the
    rays' direction (``beam``).  Errors name the row, 1 for the first view.
    """
    import pandas as pd  # takes half a second and 60 MB

    path, text = Path(path), read_text(path)
    try:
        table = pd.read_csv(StringIO(text), comment="#", skipinitialspace=True, dtype=str, sep=_separator(text))
    except ValueError as error:  # pandas' parser errors are ValueErrors
        fact = f"not a table ({' '.join(str(error).split())})"
        raise InputError(str(path), fact, f"give a CSV with the header {CSV_HEADER}") from error
    table.columns = [str(c).strip() for c in table.columns]
    missing = [c for c in VIEW_COLUMNS if c not in table.columns]
    if missing:
        raise InputError(str(path), f"no column {', '.join(missing)}", f"begin it with the header {CSV_HEADER}")
    if table.empty:
        raise InputError(str(path), "it holds no view", "give one row a radiograph")
    if table.columns.size and _separator(text) == ";":
        table = table.apply(lambda column: column.str.replace(",", "."))
    numbers = table[list(VIEW_COLUMNS)].apply(pd.to_numeric, errors="coerce").to_numpy(float)
    bad = ~np.isfinite(numbers)
    if bad.any():
        row, column = np.argwhere(bad)[0]
        fact = f"{VIEW_COLUMNS[column]} is '{table[VIEW_COLUMNS[column]].iloc[row]}' in row {row + 1} (view {row})"
        raise InputError(str(path), fact, "give 12 finite numbers a row")
    numbers = table[list(VIEW_COLUMNS)].to_numpy(object).astype(float)  # to_numeric of pandas before 3.1 loses digits
    try:
        return Geometry(numbers, shape, beam)
    except InputError as error:
        raise InputError(f"{path}, {error.where.removeprefix('geometry ')}", error.fact, error.remedy) from error


def _separator(text: str) -> str:
    """The mark between columns: a semicolon where decimals have a comma, a tab, or a comma."""
    header = next((line for line in text.splitlines() if line.strip() and not line.startswith("#")), "")
    return ";" if ";" in header else "\t" if "\t" in header and "," not in header else ","


def write_geometry(path: str | Path, geometry: Geometry) -> None:
    """Write the views of a scan, without the panel's shape and the beam; `read_geometry` restores every digit."""
    import pandas as pd  # takes half a second and 60 MB

    table = pd.DataFrame(geometry.vectors, columns=list(VIEW_COLUMNS))
    with atomic_write(path) as temporary:
        table.to_csv(temporary, index=False)
