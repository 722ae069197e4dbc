"""Geometry of a circular scan from its table in the experiment file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from grainmotion._typing import Beam, Float
from grainmotion.errors import InputError
from grainmotion.experiment.config import AngleRange, Circular
from grainmotion.experiment.config_errors import FIRST_ROW_REMEDY, together
from grainmotion.io.angles import read_angles
from grainmotion.io.files import checked_file
from grainmotion.io.hdf5 import read_angles_deg
from grainmotion.model.detector_alignment import DetectorAlignment
from grainmotion.model.geometry import Geometry

NEEDED = {"pixel_size": "give it in mm", "first_row": FIRST_ROW_REMEDY}
"""Keys that a circular scan needs from the experiment file or from a scanner's file, and what to do without."""


def scan_angles_deg(table: Circular, folder: Path, recorded: Float | None) -> Float:
    """Angles of the views, degrees: those of the table, else those ``recorded`` in the scanner's file."""
    angles = table.angles_deg
    of_range = {"first": table.first, "last": table.last, "count": table.count}
    given = [name for name, value in of_range.items() if value is not None]
    if angles is not None and given:
        fact = f"angles_deg and {', '.join(given)} are both given"
        raise InputError("geometry.angles_deg", fact, "give either")
    if given and len(given) < len(of_range):
        missing = next(name for name in of_range if name not in given)
        raise InputError(
            f"geometry.{missing}", f"it is missing beside {', '.join(given)}", "give first, last and count"
        )
    if isinstance(angles, AngleRange):
        return np.linspace(angles.first, angles.last, angles.count)
    if isinstance(angles, str):
        name, _, inner = angles.partition("::")
        path = checked_file(folder / name)
        return read_angles_deg(path, inner) if inner else read_angles(path)
    if angles is not None:
        return np.array(angles, dtype=float)
    if table.first is not None and table.last is not None and table.count is not None:
        return np.linspace(table.first, table.last, table.count)
    if recorded is not None:
        return recorded
    raise InputError("geometry.angles_deg", "it is missing", "give a list, a text file, or first, last and count")


def circular_geometry(table: Circular, beam: Beam, shape: tuple[int, int], angles_deg: Float) -> Geometry:
    """The views of a ``[….geometry]`` table, on a panel of ``shape`` rows and columns."""
    unknown = [name for name in NEEDED if getattr(table, name) is None]
    if unknown or table.pixel_size is None or table.first_row is None:
        raise together([InputError(f"geometry.{name}", "it is missing", NEEDED[name]) for name in unknown])
    panel = DetectorAlignment(
        offset=table.detector_offset,
        tilts_deg=table.detector_tilts_deg,
        axis_offset=table.axis_offset,
        axis_tilt_deg=table.axis_tilt_deg,
        first_row=table.first_row,
    )
    if beam == "parallel":
        return Geometry.parallel(angles_deg, shape, table.pixel_size, panel=panel)
    if table.source_to_axis is None or table.source_to_detector is None:
        missing = "source_to_axis" if table.source_to_axis is None else "source_to_detector"
        raise InputError(f"geometry.{missing}", "it is missing", 'give it in mm, or set beam = "parallel"')
    return Geometry.cone(
        angles_deg,
        shape,
        table.pixel_size,
        source_to_axis=table.source_to_axis,
        source_to_detector=table.source_to_detector,
        panel=panel,
    )
