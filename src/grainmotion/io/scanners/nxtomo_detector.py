"""How an NXtomo file says that frames are flipped, and which way the stage turns.

The ESRF's files of version 2 and later have the axes of NeXus; older ones have x along the beam and z up.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.io.angles import in_degrees
from grainmotion.io.hdf5_numbers import number_of, numbers_of, unit_of
from grainmotion.model.finding import Finding, Level

MIN_UPRIGHT = 0.9
"""Share of an upright axis' vector that is vertical."""
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
        values, vector = numbers_of(item.parent, item.name), _vector(item)
        if kind == "gravity" or values is None or vector is None or _is_gravity(item):
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
        remedy = "compare the drawing of inspect with the sample"
        findings.append(Finding(Level.NOTE, "sizes", "", fact, remedy=remedy))
    counter_clockwise, found = _sense(entry, up)
    return Flips(mirrored, upside_down, counter_clockwise, (*findings, *found))


def _transformations(detector: h5py.Group) -> Iterator[h5py.Dataset]:
    """The members of the detector's groups of transformations."""
    for name in detector:
        group = detector.get(name)
        if isinstance(group, h5py.Group):
            kind = str(_attribute(group, "NX_class")).lower().replace("_", "")
            if kind == "nxtransformations" or name == "transformations":
                yield from (item for item in group.values() if isinstance(item, h5py.Dataset))


def version_of(entry: h5py.Group) -> float | None:
    """Version of the ESRF's files, a number; None of others."""
    version = entry.attrs.get("version")
    return float(version) if isinstance(version, float | int | np.floating | np.integer) else None


def _frame(entry: h5py.Group) -> tuple[int, int]:
    """Which axis of the file's transformations is vertical, and which is horizontal across the beam."""
    version = version_of(entry)
    nexus = version is None or version >= FIRST_NEXUS_FRAME or "NeXus_Coordinate_System" in entry.attrs
    return (1, 0) if nexus else (2, 1)


def _sense(entry: h5py.Group, up: int) -> tuple[bool, tuple[Finding, ...]]:
    """Whether ``sample/rotation_angle`` turns about an axis that points upwards, by its own vector; findings."""
    angle = entry.get("sample/rotation_angle")
    vector = _vector(angle) if isinstance(angle, h5py.Dataset) else None
    if vector is None:
        return False, ()
    if abs(vector[up]) > MIN_UPRIGHT * np.linalg.norm(vector):
        return bool(vector[up] > 0), ()
    fact = f"the vector of rotation_angle, {', '.join(f'{v:g}' for v in vector)}, is not upright; the axis was taken so"
    remedy = "turn frames with a horizontal axis by a quarter first"
    return False, (Finding(Level.WARNING, "sizes", "", fact, remedy=remedy),)


def _vector(item: h5py.Dataset) -> Float | None:
    """The attribute ``vector``, if it is a direction."""
    try:
        vector = np.asarray(item.attrs.get("vector", []), dtype=float)
    except (TypeError, ValueError):
        return None
    return vector if vector.shape == (3,) and np.isfinite(vector).all() and vector.any() else None


def _is_gravity(item: h5py.Dataset) -> bool:
    return item.name.endswith("/gravity") or "/s" in unit_of(item)


def _attribute(item: h5py.Group | h5py.Dataset, name: str) -> object:
    value = item.attrs.get(name, "")
    return value.decode(errors="replace") if isinstance(value, bytes) else value
