"""Motions as CSV: one row a grain, the columns `MOTION_COLUMNS` of `grainmotion.model.motion_table`, then the reason,
then whether translation and rotation are results to use (`OK_COLUMNS`), and where they were measured the strains
(`STRAIN_COLUMNS`, see `grainmotion.model.strain`).

Lengths (x, u and their standard deviations) are in mm, rotation vectors w and their standard deviations in
**degrees**; `grainmotion.io.results` writes the same motions to ``motions.h5`` in radians, as `Motions` holds them.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from grainmotion._arguments import checked_arguments
from grainmotion.errors import InputError
from grainmotion.io.files import atomic_write, checked_file
from grainmotion.model.motion_table import MOTION_COLUMNS, OK_COLUMNS, STRAIN_COLUMNS
from grainmotion.model.motions import Motions

_YES_OR_NO = {"true": True, "false": False, "1": True, "0": False, "1.0": True, "0.0": False}
"""Words for yes and no."""
_WHOLE_NUMBERS = ("label", "iterations")
"""Columns of whole numbers."""
_TEXT = {column: str for column in (*MOTION_COLUMNS, *STRAIN_COLUMNS)}
"""Numbers are read as text first: those that pandas before 3.1 makes of a file are not those that were written."""


def read_motions(path: str | Path) -> Motions:
    """Read the motions of one state from a ``motions.csv``.

    Parameters
    ----------
    path : path
        The file; lengths in mm, rotations in degrees.

    Returns
    -------
    Motions
        In mm and radians.  The file holds standard deviations only, so covariances between components are 0.

    Raises
    ------
    InputError
        If the file is no such table, a label is not a whole number or is given twice, or a status is
        unknown.
    """
    import pandas as pd  # takes half a second and 60 MB

    path = checked_file(path)
    try:
        table = pd.read_csv(path, comment="#", skipinitialspace=True, dtype=_TEXT)
    except (ValueError, UnicodeDecodeError) as error:
        fact = f"not a table ({' '.join(str(error).split())})"
        raise InputError(str(path), fact, f"give a CSV with the header {','.join(MOTION_COLUMNS)}") from error
    for column in (c for c in (*MOTION_COLUMNS, *STRAIN_COLUMNS) if c in table.columns and c != "status"):
        numbers = pd.to_numeric(table[column], errors="coerce")
        wrong = numbers.isna() & table[column].notna()
        if column in _WHOLE_NUMBERS:
            wrong = numbers.isna() | (numbers % 1 != 0)
        if wrong.any():
            row = int(np.argmax(wrong.to_numpy()))
            fact = f"{column} is '{table[column].iloc[row]}' in row {row + 1}"
            raise InputError(str(path), fact, "give a number")
        table[column] = numbers if column in _WHOLE_NUMBERS else table[column].astype(float)
    for column in (c for c in OK_COLUMNS if c in table.columns):
        words = table[column].astype(str).str.strip().str.lower()
        if not words.isin(_YES_OR_NO).all():
            row = int(np.argmin(words.isin(_YES_OR_NO).to_numpy()))
            raise InputError(
                str(path), f"{column} is '{table[column].iloc[row]}' in row {row + 1}", "give True or False"
            )
        table[column] = words.map(_YES_OR_NO).astype(bool)
    if "label" in table.columns and table["label"].duplicated().any():
        repeated = int(table["label"][table["label"].duplicated()].iloc[0])
        raise InputError(str(path), f"label {repeated} is given twice", "give one row a grain")
    try:
        return Motions.from_table(table, str(path))
    except InputError as error:
        where = error.where if error.where == str(path) else f"{path} ({error.where})"
        raise InputError(where, error.fact, error.remedy) from error


@checked_arguments
def write_motions(path: str | Path, motions: Motions) -> None:
    """Write the motions of one state as a ``motions.csv``, in mm and degrees.

    Parameters
    ----------
    path : path
        The file to write.
    motions : Motions
        What is NaN is left empty.  Covariances between components and the fit as a whole are not in the file.
    """
    with atomic_write(path) as temporary:
        motions.to_table().to_csv(temporary, index=False)
