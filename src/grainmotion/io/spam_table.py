"""The table of spam's discrete correlation: its columns, what its return statuses mean, and its faults.

What spam 0.9.1 writes, found by running it:

- One row a label from 0 (background) to the largest, so that row number and label agree; labels without voxels have
  the position NaN, the displacement NaN and the return status -7.
- Columns are found by their names; their order differs between spam's programs.  Other columns do no harm, but every
  value must be a number, and a comment would be taken for the header.
- ``Zpos Ypos Xpos`` is the centroid of the label.  The displacement of ``spam-ddic`` belongs to the middle of the
  label's bounding box, that of its other programs to the position.
- ``spam-ddic -skp`` writes ``error``, ``iterations`` and ``deltaPhiNorm`` of the grains that it correlates again into
  the columns ``iterations``, ``deltaPhiNorm`` and ``LabelDilate``.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from grainmotion.errors import InputError
from grainmotion.io.files import checked_file

if TYPE_CHECKING:
    import pandas as pd

About = Literal["centroid", "box"]
"""The point of a grain whose displacement a file gives: the position of its row, which is the centroid of the label,
or the middle of the label's bounding box."""

POSITION = ("Zpos", "Ypos", "Xpos")
DISPLACEMENT = ("Zdisp", "Ydisp", "Xdisp")
GRADIENT = ("Fzz", "Fzy", "Fzx", "Fyz", "Fyy", "Fyx", "Fxz", "Fxy", "Fxx")
QUALITY = ("PSCC", "error", "iterations", "returnStatus", "deltaPhiNorm", "LabelDilate")
DDIC_COLUMNS = ("Label", *POSITION, *DISPLACEMENT, *GRADIENT, *QUALITY)
"""The columns of ``spam-ddic``, in its order."""
DISPLACEMENT_SD = ("sd_Zdisp", "sd_Ydisp", "sd_Xdisp")
"""Standard deviations of the displacement, voxels."""
ROTATION_SD = ("sd_Zrot_deg", "sd_Yrot_deg", "sd_Xrot_deg")
"""Standard deviations of rotations about the axes z, y and x of the sample, degrees."""
ABOUT_BOX, VOXEL_SIZE = "AboutBox", "VoxelSize_mm"
ADDED_COLUMNS = ("pixelSearchCC", *DISPLACEMENT_SD, *ROTATION_SD, ABOUT_BOX, VOXEL_SIZE)
"""Columns of grainmotion after those of ``spam-ddic``.

``AboutBox`` is 1 if the displacement belongs to the middle of the label's bounding box, 0 if to the row's position.
"""

RETURN_MEANINGS = {
    2: "it converged, but the file has no motion",
    1: "reached the limit of iterations",
    0: "was not correlated",
    -1: "diverged",
    -2: "singular",
    -3: "diverged by volume",
    -4: "singular",
    -5: "is too small or outside of the image",
    -7: "is missing, or had no start",
}
"""What spam's ``returnStatus`` says of a grain."""

NOT_CORRELATED = "is a guess of another program than spam-ddic, as of a pixel search or an interpolation"
"""What 1 says in files of spam's other programs."""
TSV_WANTED = "give the …-ddic.tsv that spam-ddic writes"
NOT_A_NUMBER = ("nan", "NAN", "-nan(ind)", "nan(ind)")
"""How programs write NaN, beside what pandas knows."""

MAX_ROW_BYTES = 65_536
"""Bytes at the end of a file that hold its last row."""
MAX_VOXEL_SIZE_ERROR = 1e-3
"""Relative difference of voxel sizes from which a file is one of another volume."""
_DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+(e[-+]?\d+)?", re.IGNORECASE)
WHOLE_COLUMNS = ("iterations", "LabelDilate", "returnStatus")
"""Columns of whole numbers, which are no longer such when columns were exchanged."""


def check_about(about: str | None) -> None:
    """Refuse a point that is not known."""
    if about is not None and about not in get_args(About):
        raise InputError("about", f"'{about}' is no point of a grain", "give 'centroid' or 'box'")


def meaning(returned: int, *, correlated: bool) -> str:
    """What a return status says, as the reason of a grain, in a file of spam-ddic or of spam's other programs."""
    known = NOT_CORRELATED if returned == 1 and not correlated else RETURN_MEANINGS.get(returned)
    return f"spam returned status {returned}" + (f": {known}" if known else "")


def read_table(path: str | Path) -> pd.DataFrame:
    """The table of a file, all columns that are used as numbers; those that some programs leave out as NaN or 0."""
    import pandas as pd  # takes half a second and 60 MB

    path = checked_file(path)
    try:
        with warnings.catch_warnings():  # an empty column without a name, as of a tab at the ends of lines
            warnings.simplefilter("ignore", pd.errors.ParserWarning)
            table = pd.read_csv(path, sep="\t", na_values=NOT_A_NUMBER, index_col=False, skipinitialspace=True)
    except (ValueError, UnicodeDecodeError) as error:
        raise InputError(str(path), f"it is no table ({' '.join(str(error).split())})", TSV_WANTED) from error
    table.columns = table.columns.str.strip()
    if "NodeNumber" in table.columns:
        remedy = "spam-passPhiField -pf FILE -lab1 LABELS makes one of grains, or give the one that spam-ddic writes"
        raise InputError(str(path), "it holds a grid of points (NodeNumber), not grains", remedy)
    needed = ("Label", *POSITION, *DISPLACEMENT, *GRADIENT, "returnStatus")
    missing = [c for c in needed if c not in table.columns]
    if len(missing) == len(needed):
        first = str(table.columns[0])
        separated = next((f"'{mark}'" for mark in ",; " if len(first.split(mark)) >= len(needed)), None)
        fact = f"its first line begins with {first[:40]!a}, and lacks the columns of spam"
        if separated:
            fact = f"its columns are separated by {separated}, and those of spam by tabs"
        raise InputError(str(path), fact, TSV_WANTED)
    if missing:
        raise InputError(str(path), f"columns {missing} are missing", TSV_WANTED)
    if table.empty:
        raise InputError(str(path), "it holds no row: it is truncated", "copy it again from the source")
    optional = ("error", "iterations", "LabelDilate", *DISPLACEMENT_SD, *ROTATION_SD, ABOUT_BOX, VOXEL_SIZE)
    columns = [*needed, *(c for c in optional if c in table.columns)]
    numbers = table[columns].apply(pd.to_numeric, errors="coerce")
    wrong = numbers.isna() & table[columns].notna() & (table[columns].astype(str).apply(_stripped) != "nan")
    if wrong.to_numpy().any():
        row, column = np.argwhere(wrong.to_numpy())[0]
        text = str(table[columns].iloc[row, column])
        comma = _DECIMAL_COMMA.fullmatch(text.strip()) is not None
        remedy = "save it with decimal points, not commas" if comma else "give a number"
        raise InputError(str(path), f"{columns[column]} is '{text}' in row {row + 1}", remedy)
    _check_labels(path, numbers["Label"])
    _check_ends(path, numbers["returnStatus"])
    _check_last_row(path, len(table.columns))
    _check_whole(path, numbers)
    numbers = numbers.replace([np.inf, -np.inf], np.nan)
    for column, value in (("error", np.nan), ("iterations", 0.0)):
        numbers[column] = numbers[column].fillna(value) if column in numbers.columns else value
    numbers.attrs["written by spam-ddic"] = set(QUALITY) <= set(table.columns)
    return numbers


def _stripped(column: pd.Series) -> pd.Series:
    return column.str.strip()


def point_of(table: pd.DataFrame, about: About | None) -> About:
    """The point whose displacement a table gives: as told, else as its columns tell."""
    if about is not None:
        return about
    if ABOUT_BOX in table.columns:
        return "box" if (table[ABOUT_BOX] == 1).any() else "centroid"
    return "box" if table.attrs["written by spam-ddic"] else "centroid"


def check_voxel_size(path: str | Path, table: pd.DataFrame, voxel_size: float) -> None:
    """Refuse a file that says that it is of other voxels."""
    import pandas as pd  # takes half a second and 60 MB

    sizes = table[VOXEL_SIZE].dropna() if VOXEL_SIZE in table.columns else pd.Series(dtype=float)
    if len(sizes) and abs(float(sizes.iloc[0]) / voxel_size - 1) > MAX_VOXEL_SIZE_ERROR:
        fact = (
            f"it is in voxels of {sizes.iloc[0]:.6g} mm ({VOXEL_SIZE}), and the volume has voxels of {voxel_size:.6g}"
        )
        raise InputError(str(path), fact, "give the file of this volume")


def _check_labels(path: Path, labels: pd.Series) -> None:
    if labels.isna().any() or labels.duplicated().any():
        raise InputError(str(path), "a label is missing or given twice", "give one row a grain")
    broken = (labels % 1 != 0) | (labels < 0)
    if broken.any():
        row = int(np.argmax(broken.to_numpy()))
        raise InputError(
            str(path), f"Label is {labels.iloc[row]:.10g} in row {row + 1}", "give whole numbers from 0 on"
        )


def _check_ends(path: Path, returned: pd.Series) -> None:
    if returned.isna().any():
        row = int(np.argmax(returned.isna().to_numpy()))
        fact = f"row {row + 1} has no returnStatus: the file is truncated, or a column is shifted"
        raise InputError(str(path), fact, "copy it again from the source")


def _check_last_row(path: Path, columns: int) -> None:
    """Refuse a file whose last row ends before its last column: rows below it are lost as well."""
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - MAX_ROW_BYTES))
        lines = re.split(rb"[\r\n]+", file.read().rstrip(b"\r\n"))
    count = lines[-1].count(b"\t") + 1
    if count < columns:
        fact = f"its last row has {count} of {columns} columns: the file is truncated"
        raise InputError(str(path), fact, "copy it again from the source")


def _check_whole(path: Path, numbers: pd.DataFrame) -> None:
    """Refuse a file in which numbers stand in the columns of others."""
    for column in _present(numbers, WHOLE_COLUMNS):
        values = numbers[column].to_numpy(float)
        broken = ~np.isnan(values) & (np.isinf(values) | (values != np.round(values)))
        if broken.any():
            row = int(np.argmax(broken))
            fact = (
                f"{column} is {values[row]:g} in row {row + 1}, no whole number: spam-ddic -skp (spam 0.9.1) writes "
                "error, iterations and deltaPhiNorm of the grains that it repeats into each other's columns"
            )
            raise InputError(str(path), fact, "run spam-ddic without -skp, from this file by -pf")


def _present(numbers: pd.DataFrame, columns: Iterable[str]) -> list[str]:
    return [c for c in columns if c in numbers.columns]
