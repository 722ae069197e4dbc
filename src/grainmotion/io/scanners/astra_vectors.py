"""Vectors of ASTRA's ``cone_vec`` and ``parallel3d_vec``: 12 columns, one row a view, as .npy or as text (.geom).

Facts: the ASTRA toolbox's page on 3D geometries.  ``.geom`` is what numpy.savetxt writes of them, as in the walnuts of
Der Sarkissian et al., Sci. Data 6, 215 (2019).  The files tell neither the beam nor the unit of length.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from grainmotion._typing import Beam, Float
from grainmotion.errors import InputError
from grainmotion.io.files import checked_file
from grainmotion.io.formats import check_npy
from grainmotion.io.scanners.view_panel import Panel
from grainmotion.io.text import read_text
from grainmotion.model.geometry import VIEW_COLUMNS, Geometry

COLUMNS_OF_SLICES = 6
GIVE_TWELVE = f"give one row a view: {','.join(VIEW_COLUMNS)}"


def read_astra_vectors(path: Path, panel: Panel) -> Geometry:
    """The views of a file; lengths are scaled so that a pixel has the panel's ``pixel_size`` if that is given."""
    numbers = _of_array(path) if path.suffix.lower() == ".npy" else _of_text(path)
    if numbers.ndim != 2 or numbers.shape[1] != len(VIEW_COLUMNS):
        fact = f"an array {numbers.shape} is no list of views"
        if numbers.ndim == 2 and numbers.shape[1] == COLUMNS_OF_SLICES:
            fact = "6 columns are of a geometry in a plane (parallel_vec, fanflat_vec)"
        raise InputError(str(path), fact, GIVE_TWELVE)
    bad = np.flatnonzero(~np.isfinite(numbers).all(axis=1))
    if len(bad):
        raise InputError(str(path), f"row {bad[0] + 1} (view {bad[0]}) holds NaN or infinity", GIVE_TWELVE)
    _check_beam(path, numbers, panel.beam)
    if panel.pixel_size is not None:
        step = float(np.linalg.norm(numbers[:, 6:9], axis=1).mean())
        lengths = slice(0 if panel.beam == "cone" else 3, 12)
        numbers[:, lengths] *= panel.pixel_size / step if step > 0 else 1.0
    try:
        return Geometry(numbers, panel.shape, panel.beam)
    except InputError as error:
        raise InputError(f"{path}, {error.where.removeprefix('geometry ')}", error.fact, error.remedy) from error


def _check_beam(path: Path, numbers: Float, beam: Beam) -> None:
    """Refuse vectors of the other kind of beam, where they show it."""
    lengths = np.linalg.norm(numbers[:, :3], axis=1)
    against = (numbers[:, :3] * numbers[:, 3:6]).sum(axis=1) < 0
    if beam == "cone" and np.allclose(lengths, 1, rtol=1e-6) and not against.all():
        fact = "its first three columns are directions of length 1, as of a parallel beam"
        raise InputError(str(path), fact, 'set beam = "parallel", or give the places of the source')
    if beam == "parallel" and against.all() and lengths.min() > 2:
        fact = "its first three columns are places of a source opposite the panel, as of a cone beam"
        raise InputError(str(path), fact, 'set beam = "cone"')


def _of_array(path: Path) -> Float:
    check_npy(checked_file(path))
    try:
        array = np.load(path, allow_pickle=False)
    except (ValueError, EOFError, OSError) as error:
        fact = f"truncated or damaged .npy ({error})"
        raise InputError(str(path), fact, "save it again with numpy.save") from error
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "iuf":
        raise InputError(str(path), "it holds no array of numbers", GIVE_TWELVE)
    return array.astype(float)


def _of_text(path: Path) -> Float:
    rows: list[list[float]] = []
    for k, line in enumerate(read_text(path).split("\n"), start=1):
        content = line.split("#")[0].replace(",", " ").split()
        try:
            row = [float(cell) for cell in content]
        except ValueError as error:
            shown = line.strip()[:57]
            raise InputError(str(path), f"line {k} is '{shown}', no numbers", GIVE_TWELVE) from error
        if row and rows and len(row) != len(rows[0]):
            fact = f"line {k} has {len(row)} numbers, and the lines before it {len(rows[0])}"
            raise InputError(str(path), fact, GIVE_TWELVE)
        rows += [row] if row else []
    return np.array(rows, dtype=float, ndmin=2)
