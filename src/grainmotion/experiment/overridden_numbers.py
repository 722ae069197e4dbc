"""Numbers of the experiment file that stand against those of a scanner's file."""

from __future__ import annotations

import numpy as np

from grainmotion._typing import Float
from grainmotion.experiment.recorded import CircularScan
from grainmotion.io.scanners.description import ScannerFile
from grainmotion.model.finding import Finding, Level
from grainmotion.model.geometry import Geometry

MAX_NUMBER_RATIO = 1.02
"""A length of the experiment file that differs by more from the scanner's is probably a mistake in one of them."""
NO_LENGTHS = ("axis_offset",)
"""Numbers that may be near zero, and are found anew for each scan."""


def overridden(
    key: str, told: ScannerFile | None, origin: ScannerFile | None, circle: CircularScan | None, geometry: Geometry
) -> tuple[Finding, ...]:
    """Numbers of the scanner's file that the experiment file overrides; lengths that differ much are doubtful.

    A file may tell the pixel at the sample instead of that on the panel.
    """
    own = told or origin
    if own is None or circle is None:
        return ()
    found = []
    for name, value in own.circle.known.items():
        given = getattr(circle.table, name)
        if given is None or given == value:
            continue
        also = (geometry.pixel_at((0, 0, 0)),) if name == "pixel_size" else ()
        found += _contradiction(key, name, (given, *also), value, own)
    table, recorded = circle.table, None if told is None else told.circle.angles_deg
    if recorded is not None and not _same_angles(recorded, circle.angles_deg):
        fact = f"the angles of the experiment file are used, not those of {own.path.name}"
        shown = f"{circle.angles_deg[:3]} of the experiment file, {recorded[:3]} of {own.path.name}"
        found.append(Finding(Level.NOTE, "sizes", f"{key}.geometry.angles_deg", fact, shown))
    alone = own.axis_to_detector if own.circle.source_to_detector is None else None
    if alone and table.source_to_axis and table.source_to_detector and geometry.beam == "cone":
        distances = (table.source_to_detector - table.source_to_axis, table.source_to_detector)
        name = "source_to_detector less source_to_axis"
        found += _contradiction(key, name, distances, alone, own)
    return tuple(found)


def _same_angles(first_deg: Float, second_deg: Float) -> bool:
    return len(first_deg) == len(second_deg) and bool(np.allclose(first_deg, second_deg, atol=1e-6))


def _contradiction(key: str, name: str, told: tuple[object, ...], value: object, own: ScannerFile) -> list[Finding]:
    """A finding about what is told and a file's own ``value``, none about lengths that are nearly equal."""
    where, shown = f"{key}.geometry.{name}", f"{told[0]} of the experiment file, {value} of {own.path.name}"
    if name in NO_LENGTHS or not isinstance(value, float) or not isinstance(told[0], float):
        if isinstance(value, float) and isinstance(told[0], float) and np.isclose(value, told[0]):
            return []
        fact = f"{name} of the experiment file is used, not that of {own.path.name}"
        return [Finding(Level.NOTE, "sizes", where, fact, shown)]
    if any(isinstance(t, float) and 1 / MAX_NUMBER_RATIO < t / value < MAX_NUMBER_RATIO for t in told):
        return []
    fact = f"{name} of the experiment file contradicts {own.path.name}; the former is used"
    remedy = "leave the key out unless the scanner's file is known to be wrong"
    shown = f"{told[0]:.5g} mm of the experiment file, {value:.5g} mm of {own.path.name}"
    return [Finding(Level.WARNING, "sizes", where, fact, shown, remedy)]
