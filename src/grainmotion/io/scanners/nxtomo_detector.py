"""How an NXtomo file says that frames are flipped, where the axis is on them, and which way the stage turns.

The ESRF's files of version 2 and later have the axes of NeXus; older ones have x along the beam and z up.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from grainmotion.errors import InputError
from grainmotion.io.angles import in_degrees
from grainmotion.io.hdf5_numbers import number_of, numbers_of, text_of, unit_of
from grainmotion.model.finding import Finding, Level

AXIS_NAMES = ("x_rotation_axis_pixel_position", "estimated_cor_from_motor", "estimated_cor_frm_motor")
NEAR_THE_MIDDLE = 0.25
"""A column within this share of the width from the middle counts from the left; a smaller number from the middle."""
FIRST_NEXUS_FRAME = 2.0
"""Version of the ESRF's files from which their axes are those of NeXus: z along the beam and y up."""


@dataclass(frozen=True)
class Flips:
    """What a file says about the orientation of its frames.

    Attributes
    ----------
    mirrored, upside_down : bool, optional
        Whether columns run from right to left, seen from the source, and rows from the base up; None if not told.
    counter_clockwise : bool
        Whether the stage turns counter-clockwise, seen from above, as the angle grows.
    findings : tuple of Finding
        What was read from the transformations, or not used.
    """

    mirrored: bool | None = None
    upside_down: bool | None = None
    counter_clockwise: bool = False
    findings: tuple[Finding, ...] = ()


def flips_of(entry: h5py.Group, path: Path) -> Flips:
    """The flips of the detector: ``x_flipped`` and ``y_flipped``, or rotations by 180 degrees."""
    detector = entry["instrument/detector"]
    up, across = _frame(entry)
    told: dict[int, bool] = {}
    other = []
    for item in _transformations(detector):
        kind = str(_attribute(item, "transformation_type"))
        values, vector = numbers_of(item.parent, item.name), np.asarray(item.attrs.get("vector", []), dtype=float)
        if kind == "gravity" or values is None or vector.shape != (3,) or not vector.any() or _is_gravity(item):
            continue
        turns = in_degrees(values, unit_of(item), f"{path}::{item.name}") % 360 if kind == "rotation" else values
        axis = int(np.argmax(np.abs(vector)))
        if kind == "rotation" and np.all(np.isin(turns, (0, 180))) and np.ptp(turns) == 0:
            told[axis] = told.get(axis, False) ^ bool(turns[0])
        elif values.any():
            other.append(item.name.rsplit("/", 1)[-1])
    beam = ({0, 1, 2} - {up, across}).pop()
    about_beam = told.pop(beam, False)
    mirrored, upside_down = told.get(up), told.get(across)
    for name, value in (("x_flipped", mirrored), ("y_flipped", upside_down)):
        flag = number_of(detector, name)
        if flag is not None and value is not None and bool(flag) != value:
            fact = f"{name} contradicts the detector's transformations"
            raise InputError(str(path), fact, "correct the one that is wrong")
        if flag is not None:
            mirrored, upside_down = (bool(flag), upside_down) if name == "x_flipped" else (mirrored, bool(flag))
    if about_beam:
        mirrored, upside_down = not mirrored, not upside_down
    findings = []
    if other:
        fact = f"the detector's transformations {', '.join(other)} were not used"
        remedy = "if the panel is tilted or off the beam, see detector_tilts_deg and detector_offset"
        findings.append(Finding(Level.NOTE, "sizes", "", fact, remedy=remedy))
    if mirrored or upside_down:
        words = [word for word, flag in (("left to right", mirrored), ("upside down", upside_down)) if flag]
        fact = f"the file says that its frames are flipped {' and '.join(words)}; this was undone"
        findings.append(Finding(Level.NOTE, "sizes", "", fact, remedy="compare the drawing of inspect with the sample"))
    return Flips(mirrored, upside_down, _counter_clockwise(entry, up), tuple(findings))


def axis_column(detector: h5py.Group, width: int) -> tuple[float | None, Finding | None]:
    """The column on which the axis is seen, from 0, or why it cannot be told.

    Writers count it from the left (NeXus) or from the middle (the ESRF's, from the motors' places).  A number that is
    near the middle in one of the two ways is that; a scan with the axis at the edge of the panel may be either.
    """
    name, value = next(((n, v) for n in AXIS_NAMES if (v := number_of(detector, n)) is not None), ("", None))
    if value is None or not np.isfinite(value):
        return None, None
    middle = (width - 1) / 2
    half = text_of(detector, "field_of_view").lower() == "half" or bool(number_of(detector, "half_acquisition"))
    if value < 0 and abs(value) < width:
        return middle + value, None
    if not half and abs(value - middle) < NEAR_THE_MIDDLE * width:
        return value, None
    if not half and value < NEAR_THE_MIDDLE * width:
        return middle + value, None
    fact = f"{name} is {value:g} of {width} columns: whether from the left or from the middle is not clear"
    remedy = "it was not used; give geometry.axis_offset, in mm"
    return None, Finding(Level.WARNING, "sizes", "", fact, remedy=remedy)


def _transformations(detector: h5py.Group) -> Iterator[h5py.Dataset]:
    """The members of the detector's groups of transformations."""
    for name in detector:
        group = detector.get(name)
        if isinstance(group, h5py.Group):
            kind = str(_attribute(group, "NX_class")).lower().replace("_", "")
            if kind == "nxtransformations" or name == "transformations":
                yield from (item for item in group.values() if isinstance(item, h5py.Dataset))


def version_of(entry: h5py.Group) -> float | None:
    """Version of the ESRF's files; None of others."""
    try:
        return float(entry.attrs["version"])
    except (KeyError, TypeError, ValueError):
        return None


def _frame(entry: h5py.Group) -> tuple[int, int]:
    """Which axis of the file's transformations is vertical, and which is horizontal across the beam."""
    version = version_of(entry)
    nexus = version is None or version >= FIRST_NEXUS_FRAME or "NeXus_Coordinate_System" in entry.attrs
    return (1, 0) if nexus else (2, 1)


def _counter_clockwise(entry: h5py.Group, up: int) -> bool:
    """Whether ``sample/rotation_angle`` is a rotation about an axis that points upwards, by its own vector."""
    angle = entry.get("sample/rotation_angle")
    vector = np.asarray(angle.attrs.get("vector", []) if isinstance(angle, h5py.Dataset) else [], dtype=float)
    return bool(vector.shape == (3,) and vector[up] > 0.5 * np.abs(vector).max())


def _is_gravity(item: h5py.Dataset) -> bool:
    return item.name.endswith("/gravity") or "/s" in unit_of(item)


def _attribute(item: h5py.Group | h5py.Dataset, name: str) -> object:
    value = item.attrs.get(name, "")
    return value.decode(errors="replace") if isinstance(value, bytes) else value
