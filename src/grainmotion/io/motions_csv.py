"""Motions as CSV: mm and degrees, one row a grain, the columns of `grainmotion.model.motions.COLUMNS`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from grainmotion.errors import InputError
from grainmotion.io.files import atomic_write, checked_file
from grainmotion.model.motions import COLUMNS, Motions


def read_motions(path: str | Path) -> Motions:
    """Read a ``motions.csv``; it holds variances only, so covariances between components are 0.

    Raises
    ------
    InputError
        If the file is no such table, a label is not a whole number or is given twice, or a status is
        unknown.
    """
    path = checked_file(path)
    try:
        table = pd.read_csv(path, comment="#", skipinitialspace=True)
    except (ValueError, UnicodeDecodeError) as error:
        fact = f"not a table ({' '.join(str(error).split())})"
        raise InputError(str(path), fact, f"give a CSV with the header {','.join(COLUMNS)}") from error
    for column in (c for c in COLUMNS if c in table.columns and c != "status"):
        numbers = pd.to_numeric(table[column], errors="coerce")
        wrong = numbers.isna() & table[column].notna()
        if column in ("label", "iterations"):
            wrong = numbers.isna() | (numbers % 1 != 0)
        if wrong.any():
            row = int(np.argmax(wrong.to_numpy()))
            fact = f"{column} is '{table[column].iloc[row]}' in row {row + 1}"
            raise InputError(str(path), fact, "give a number")
        table[column] = numbers
    if "label" in table.columns and table["label"].duplicated().any():
        twice = int(table["label"][table["label"].duplicated()].iloc[0])
        raise InputError(str(path), f"label {twice} is given twice", "give one row a grain")
    try:
        return Motions.from_table(table, str(path))
    except InputError as error:
        where = error.where if error.where == str(path) else f"{path} ({error.where})"
        raise InputError(where, error.fact, error.remedy) from error


def write_motions(path: str | Path, motions: Motions) -> None:
    """Write a ``motions.csv``; what was not measured is left empty."""
    with atomic_write(path) as temporary:
        motions.to_table().to_csv(temporary, index=False)
