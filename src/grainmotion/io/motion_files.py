"""Motions of one state to and from files, the format by the suffix: a table (CSV), or everything (HDF5)."""

from __future__ import annotations

from pathlib import Path

from grainmotion._arguments import checked_arguments
from grainmotion.errors import InputError
from grainmotion.io import motions_csv
from grainmotion.io.results import read_motions_h5, write_motions_h5
from grainmotion.model.motions import Motions

_HDF5_SUFFIXES = (".h5", ".hdf5")
_CSV_SUFFIXES = (".csv", ".txt", "")


@checked_arguments
def read_motions(path: str | Path) -> Motions:
    """Read the motions of one state from a ``motions.csv`` or a ``motions.h5``.

    Parameters
    ----------
    path : path
        A ``.h5`` file, which holds covariances and the fit too; any other file is read as a table, with lengths in mm
        and rotations in degrees.

    Returns
    -------
    Motions
        In mm and radians.  A table holds standard deviations only, so covariances between components are 0.

    Raises
    ------
    InputError
        If the file is no such table or HDF5 file, a label is not a whole number or is given twice, or a status is
        unknown.

    Examples
    --------
    >>> import grainmotion as gm
    >>> motions = gm.read_motions("results/step-01/motions.h5")  # doctest: +SKIP
    """
    if Path(path).suffix.lower() in _HDF5_SUFFIXES:
        return read_motions_h5(path)
    return motions_csv.read_motions(path)


@checked_arguments
def write_motions(path: str | Path, motions: Motions) -> None:
    """Write the motions of one state as a table (``.csv``) or with everything that is known of them (``.h5``).

    Parameters
    ----------
    path : path
        The file to write.  ``.csv`` is the table of ``motions.csv`` in mm and degrees, without covariances between
        components and the fit as a whole; ``.h5`` a ``motions.h5`` in mm and radians, from which `read_motions` gives
        the same motions.
    motions : Motions
        What is NaN is left empty in a table.

    Raises
    ------
    InputError
        If the suffix is another one, or the file cannot be written.

    Examples
    --------
    >>> import grainmotion as gm
    >>> motions = gm.Motions.identity([1, 2], [[0, 0, 0], [1, 1, 1]])
    >>> gm.write_motions("motions.h5", motions)  # doctest: +SKIP
    """
    suffix = Path(path).suffix.lower()
    if suffix in _HDF5_SUFFIXES:
        write_motions_h5(path, motions)
    elif suffix in _CSV_SUFFIXES:
        motions_csv.write_motions(path, motions)
    else:
        raise InputError(str(path), f"'{suffix}' is no format of motions", "use .csv for a table, .h5 for everything")
