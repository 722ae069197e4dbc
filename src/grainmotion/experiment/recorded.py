"""What an NXtomo file records of the beam and of the stage during a scan, and how it changes levels and geometry.

Lab frame of a circular scan: that of the sample at θ = 0, so x to higher columns, y along the beam, z up.  A stage
that carries the sample, and the rotation axis with it, by t in the lab frame shifts source and panel by −t as the
sample sees them, rotated by θ like source and panel themselves.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from grainmotion._typing import Float, Index
from grainmotion.experiment.scan_tables import Circular, Direction
from grainmotion.io.hdf5 import FLAT, PROJECTION, NXtomo
from grainmotion.io.nxtomo_records import MONITOR, TRANSLATIONS, Record
from grainmotion.model.finding import Finding, Level
from grainmotion.model.geometry import Geometry
from grainmotion.rotations import rotation_matrix

Directions = tuple[Direction, Direction, Direction]
Motors = Literal[False] | Directions | None
STAGE_DIRECTIONS: Directions = ("x", "y", "z")
"""Directions in the lab frame of x_, y_ and z_translation unless told otherwise."""
LAB_AXES = ("x", "y", "z")
MIN_STAGE_SHIFT = 0.02
"""Shift of the stage that is used, pixels at the sample; encoders of a stage at rest vary by less."""
MAX_SIDEWAYS = 1.0
"""Largest shift across the beam that can be, over the width of the field of view: beyond it nothing is in view."""
MAX_HELIX = 20.0
"""Largest shift along the axis, over the height of the field of view."""
STEADY_MONITOR = 1e-4
"""Variation of a monitor, relative, up to which nothing is divided."""
MAX_MONITOR_RATIO = 20.0
"""Largest over smallest number of a monitor that is one: a clock, a counter or noise about zero exceed it."""


@dataclass(frozen=True, eq=False)
class CircularScan:
    """A table of a circular scan and the angles of its views, degrees."""

    table: Circular
    angles_deg: Float
    findings: tuple[Finding, ...] = ()  # how the angles were found, where it is not obvious


@dataclass(frozen=True, eq=False)
class Told:
    """Views as the experiment file tells them: all of the file's projections, or the chosen ones."""

    geometry: Geometry
    circle: CircularScan | None  # None if they are from a table of views
    views: Index | None  # the chosen projections; None for all


@dataclass(frozen=True, eq=False)
class Recorded:
    """What a file records of the views of a scan, and the findings about it."""

    monitor: Float | None = None  # −ln of the beam over that of the flats, in each projection of the file
    shifts: Float | None = None  # of the stage in each projection of the file, ``(projections, 3)``, mm, lab frame
    findings: tuple[Finding, ...] = ()


def beam_monitor(where: str, nxtomo: NXtomo, flats: NXtomo | None) -> Recorded:
    """The beam monitor of a file, which serves if it is a number above zero in each frame; of ``flats`` likewise."""
    record, open_beam = _named(nxtomo, MONITOR), None if flats is None else _named(flats, MONITOR)
    if record is None:
        return Recorded()
    reference = None if flats is None or open_beam is None else open_beam.values[flats.keys == FLAT]
    values = record.values[nxtomo.keys == PROJECTION]
    problem = (
        record.problem or (open_beam.problem if open_beam is not None else "") or _monitor_problem(values, reference)
    )
    if problem:
        fact = f"the beam monitor {MONITOR} was not used: {problem}"
        remedy = "if the beam was not steady, see [calibrate] beam_level"
        return Recorded(findings=(Finding(Level.WARNING, "monitor", where, fact, remedy=remedy),))
    levels = -np.log(values / (np.median(values) if reference is None else reference.mean()))
    if np.abs(levels).max() <= STEADY_MONITOR:
        return Recorded()
    fact = f"counts were divided by the beam monitor {MONITOR}"
    fact += ", relative to its median, as it has no numbers for the flats" if reference is None else ""
    evidence = f"{100 * np.exp(-levels.max()):.1f} to {100 * np.exp(-levels.min()):.1f} % of the beam of the flats"
    return Recorded(levels, findings=(Finding(Level.NOTE, "monitor", where, fact, evidence),))


def stage_shifts(where: str, nxtomo: NXtomo, origin: NXtomo | None, motors: Motors) -> Recorded:
    """Shift of the stage in each projection from its place in the first projection of ``origin``, or of the file."""
    if motors is False or nxtomo.count(PROJECTION) == 0:
        return Recorded()
    shifts, findings = np.zeros((nxtomo.count(PROJECTION), 3)), list[Finding]()
    for name, direction in zip(TRANSLATIONS, motors or STAGE_DIRECTIONS, strict=True):
        record = _named(nxtomo, name)
        if record is None:
            continue
        values, problem = _millimetres(record, nxtomo)
        if problem:
            fact = f"{name} was not used: {problem}; if the stage moved, the motions of all grains are wrong"
            findings.append(Finding(Level.WARNING, "motors", where, fact, remedy="correct the file"))
            continue
        zero = float(values[0]) if origin is None else _start(origin, name, float(values[0]))
        if not record.unit and np.ptp(values - zero) > 0:
            fact = f"{name} names no unit; it was taken as mm"
            findings.append(Finding(Level.WARNING, "motors", where, fact, remedy="add the attribute units"))
        sign = -1 if direction.startswith("-") else 1
        shifts[:, LAB_AXES.index(direction[-1])] += sign * (values - zero)
    return Recorded(shifts=shifts, findings=tuple(findings))


def recorded_geometry(
    where: str, nxtomo: NXtomo, told: Told, recorded: Recorded
) -> tuple[Geometry, tuple[Finding, ...]]:
    """The views with the stage where the file records it, and findings about the stage."""
    geometry, circle, shifts = told.geometry, told.circle, recorded.shifts
    findings = list(recorded.findings)
    if shifts is not None and len(geometry) != len(shifts):
        shifts = shifts[told.views] if told.views is not None and len(told.views) == len(geometry) else None
    if shifts is None:
        return geometry, tuple(findings)
    pixel = geometry.pixel_at((0, 0, 0))
    shifts, found = _possible(where, geometry, pixel, shifts)
    findings += found
    if np.abs(shifts).max(initial=0) < MIN_STAGE_SHIFT * pixel:
        return geometry, tuple(findings)
    spans = [f"{n} {s.min():.4g} to {s.max():.4g} mm" for n, s in zip(LAB_AXES, shifts.T, strict=True) if s.any()]
    if circle is None:
        fact = "the recorded translations of the stage were not used, as a table of views holds whole positions"
        remedy = "see that it holds them"
    else:
        geometry = moved_geometry(geometry, circle.table.axis_tilt_deg, circle.angles_deg, shifts)
        fact = "the recorded translations of the stage were used, counted from the first projection of the reference"
        remedy = f"if they point elsewhere or are no motion of the sample, see {where}.motors"
    findings.append(Finding(Level.NOTE, "motors", where, fact, ", ".join(spans), remedy))
    return geometry, tuple(findings)


def _possible(where: str, geometry: Geometry, pixel: float, shifts: Float) -> tuple[Float, list[Finding]]:
    """Shifts that leave something in view; zero along the other axes."""
    shifts, findings = shifts.copy(), list[Finding]()
    height, width = (n * pixel for n in geometry.shape)
    depth = float(np.linalg.norm(geometry.source[0])) / 2 if geometry.beam == "cone" else np.inf
    for axis, limit in enumerate((MAX_SIDEWAYS * width, depth, MAX_HELIX * height)):
        largest = float(np.abs(shifts[:, axis]).max(initial=0))
        if largest > limit:
            fact = f"the stage is recorded {largest:.4g} mm off along {LAB_AXES[axis]}, where nothing would be in view"
            remedy = f"this was not used; check the units in the file, or see {where}.motors"
            findings.append(Finding(Level.WARNING, "motors", where, fact, f"limit {limit:.4g} mm", remedy))
            shifts[:, axis] = 0
    return shifts, findings


def moved_geometry(
    geometry: Geometry, axis_tilt_deg: tuple[float, float], angles_deg: Float, shifts: Float
) -> Geometry:
    """The views of a circular scan whose sample was moved by ``shifts (views, 3)`` in the lab frame, mm."""
    untilt = rotation_matrix(np.deg2rad([*axis_tilt_deg, 0.0])).T
    stage = rotation_matrix(np.deg2rad(angles_deg)[:, None] * np.array([0.0, 0.0, 1.0]))
    back = np.einsum("vij,vj->vi", stage, shifts @ untilt.T)
    vectors = geometry.vectors.copy()
    vectors[:, 3:6] -= back
    if geometry.beam == "cone":
        vectors[:, :3] -= back
    return Geometry(vectors, geometry.shape, geometry.beam)


def _monitor_problem(values: Float, flats: Float | None) -> str:
    """Why a monitor cannot be used; empty if it can."""
    used = values if flats is None else np.concatenate([values, flats])
    bad = ~(np.isfinite(used) & (used > 0))
    if bad.any():
        return f"it is zero, negative or no number in {int(bad.sum())} of {len(used)} frames"
    if used.max() > MAX_MONITOR_RATIO * used.min():
        return f"it varies from {used.min():.4g} to {used.max():.4g}, which no beam does"
    return ""


def _millimetres(record: Record, nxtomo: NXtomo) -> tuple[Float, str]:
    """A translation in each projection, mm, or why it cannot be used."""
    values = record.values[nxtomo.keys == PROJECTION]
    if record.problem:
        return values, record.problem
    if not np.isfinite(values).all():
        return values, f"it is no number in {int((~np.isfinite(values)).sum())} of {len(values)} projections"
    if record.scale is None:
        return values, f"its unit '{record.unit}' is no length"
    return values * record.scale, ""


def _start(nxtomo: NXtomo, name: str, otherwise: float) -> float:
    """Place in the first projection, mm."""
    record = _named(nxtomo, name)
    if record is None:
        return otherwise
    values, problem = _millimetres(record, nxtomo)
    return otherwise if problem or not len(values) else float(values[0])


def _named(nxtomo: NXtomo, name: str) -> Record | None:
    return next((record for record in nxtomo.records if record.name == name), None)
