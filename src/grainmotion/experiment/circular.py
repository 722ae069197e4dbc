"""Geometry of a circular scan from its table in the experiment file."""

from __future__ import annotations

from grainmotion._typing import Beam, Float
from grainmotion.errors import InputError
from grainmotion.experiment.config_errors import DISTANCE_REMEDY, DISTANCES, FIRST_ROW_REMEDY, together
from grainmotion.experiment.scan_tables import Circular
from grainmotion.model.detector_alignment import DetectorAlignment
from grainmotion.model.geometry import Geometry

NEEDED = {"pixel_size": "give it in mm", "first_row": FIRST_ROW_REMEDY}
"""Keys that a circular scan needs from the experiment file or from a scanner's file, and what to do without."""


def circular_geometry(table: Circular, beam: Beam, shape: tuple[int, int], angles_deg: Float) -> Geometry:
    """The views of a ``[….geometry]`` table, on a panel of ``shape`` rows and columns."""
    unknown = [name for name in NEEDED if getattr(table, name) is None]
    if unknown or table.pixel_size is None or table.first_row is None:
        raise together([InputError(f"geometry.{name}", "it is missing", NEEDED[name]) for name in unknown])
    panel = DetectorAlignment(
        detector_offset=table.detector_offset,
        detector_tilts_deg=table.detector_tilts_deg,
        axis_offset=table.axis_offset,
        axis_tilt_deg=table.axis_tilt_deg,
        first_row=table.first_row,
    )
    if beam == "parallel":
        return Geometry.parallel(angles_deg, shape, table.pixel_size, panel=panel)
    if table.source_to_axis is None or table.source_to_detector is None:
        unknown = [name for name in DISTANCES if getattr(table, name) is None]
        raise together([InputError(f"geometry.{name}", "it is missing", DISTANCE_REMEDY) for name in unknown])
    return Geometry.cone(
        angles_deg,
        shape,
        table.pixel_size,
        source_to_axis=table.source_to_axis,
        source_to_detector=table.source_to_detector,
        panel=panel,
    )
