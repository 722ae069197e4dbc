"""What the told angles of a scan say by themselves: units, coincidences, a value out of line.

Interlaced, golden-ratio and decreasing angles, half turns and chosen views are right and give no finding.
"""

from __future__ import annotations

import numpy as np

from grainmotion._typing import Float
from grainmotion.model.finding import Check, Finding, Level

ANGLE_TABLE: Check = "angle-table"
MIN_VIEWS_OF_A_SCAN = 10
"""Fewer are views of a state, or too few to judge their units by their span."""
MAX_SPAN_OF_RADIANS = 6.4
"""A full turn in radians is 6.28; a scan that spans less degrees than this cannot be reconstructed anyway."""
MAX_STEP_IN_DEG = 360.0
"""Larger steps are thousandths of a degree, steps of a motor, or the like; a golden-ratio scan has 222.5 at most."""
MAX_DIFFERENCE_OF_EQUAL_DEG = 1e-6
"""Angles that come from a CSV of views are rounded in the ninth digit."""
MAX_EQUAL_PAIRS = 2
"""More neighbouring views of equal angles come from rounding, not from misprints."""
MAX_STEPS_OUT_OF_LINE = 3.0
"""An angle is out of line if it is off by more than three steps between neighbours that are two steps apart."""
MIN_ROUND_RADIANS_DEG = 5.0
"""Angles in radians of views chosen by hand are multiples of this many degrees, but for rounding."""


def angle_findings(where: str, angles_deg: Float) -> tuple[Finding, ...]:
    """Findings about told angles, in the order of the views."""
    if len(angles_deg) < 2:
        return ()
    return (*_units(where, angles_deg), *_coincidences(where, angles_deg), *_out_of_line(where, angles_deg))


def _units(where: str, angles_deg: Float) -> list[Finding]:
    """A span that is no scan in degrees."""
    span = float(np.ptp(angles_deg))
    if span == 0:
        fact = "all views have the same angle"
        level = Level.ERROR if len(angles_deg) >= MIN_VIEWS_OF_A_SCAN else Level.WARNING
        return [Finding(level, ANGLE_TABLE, where, fact, f"{angles_deg[0]:g} degrees", "give each view its angle")]
    evidence = f"{len(angles_deg)} views from {angles_deg.min():.4g} to {angles_deg.max():.4g}"
    if len(angles_deg) >= MIN_VIEWS_OF_A_SCAN and span < MAX_SPAN_OF_RADIANS:
        unit = "turns" if span <= 1.01 else "radians"
        fact = f"the angles of the scan span {span:.4g} degrees only: probably they are in {unit}"
        fix = "angles-in-radians" if unit == "radians" else ""
        return [Finding(Level.ERROR, ANGLE_TABLE, where, fact, evidence, "give them in degrees", fix)]
    if len(angles_deg) < MIN_VIEWS_OF_A_SCAN and span < MAX_SPAN_OF_RADIANS and _round_radians(angles_deg):
        fact = f"the angles span {span:.4g} degrees only and are round in radians: probably they are in radians"
        remedy = "give them in degrees"
        return [Finding(Level.WARNING, ANGLE_TABLE, where, fact, evidence, remedy, "angles-in-radians")]
    if abs(np.median(np.diff(angles_deg))) > MAX_STEP_IN_DEG:
        fact = f"the angles span {span / 360:.4g} turns: probably they are not in degrees"
        return [Finding(Level.WARNING, ANGLE_TABLE, where, fact, evidence, "give them in degrees")]
    return []


def _round_radians(angles: Float) -> bool:
    """Whether numbers with a fraction are multiples of 5 degrees if they are radians."""
    degrees = np.rad2deg(angles - angles[0]) / MIN_ROUND_RADIANS_DEG
    whole = np.abs(angles - np.round(angles)) < 1e-3
    return not whole.all() and bool(np.all(np.abs(degrees - np.round(degrees)) < 0.02))


def _coincidences(where: str, angles_deg: Float) -> list[Finding]:
    """Views of one direction: the end point, or an angle that is written twice."""
    turned = np.round(angles_deg % 360, 6) % 360
    _, first, inverse, counts = np.unique(turned, return_index=True, return_inverse=True, return_counts=True)
    repeated = int((counts - 1).sum())
    if repeated == 0 or np.ptp(angles_deg) == 0:
        return []
    equal = np.flatnonzero(np.abs(np.diff(angles_deg)) < MAX_DIFFERENCE_OF_EQUAL_DEG)
    if len(equal):
        k = int(equal[0])
        fact = f"views {k} and {k + 1} have the same angle"
        if len(equal) > MAX_EQUAL_PAIRS:
            fact = "neighbouring views have equal angles: written with too few digits?"
        evidence = f"{angles_deg[k]:g} degrees; {len(equal)} such pairs"
        remedy = "if it is a mistake, correct it: the angles behind it may be shifted"
        return [Finding(Level.WARNING, ANGLE_TABLE, where, fact, evidence, remedy)]
    if repeated == 1:
        j = int(np.flatnonzero(counts[inverse.ravel()] > 1)[1])
        k = int(first[inverse.ravel()[j]])
        count, span = len(angles_deg), angles_deg[-1] - angles_deg[0]
        if (k, j) == (0, count - 1) and count > 2:
            end = angles_deg[0] + span * (count - 1) / count
            fact = "the first and the last view are told to be one direction"
            evidence = f"{angles_deg[0]:g} and {angles_deg[-1]:g} degrees, {count} views"
            remedy = f"if the scan stops one step before the full turn, its last angle is {end:g}"
            return [Finding(Level.NOTE, ANGLE_TABLE, where, fact, evidence, remedy)]
    return []


def _out_of_line(where: str, angles_deg: Float) -> list[Finding]:
    """Single angles far from both neighbours, which lie two steps apart: misprints."""
    if len(angles_deg) < MIN_VIEWS_OF_A_SCAN:
        return []
    step = float(np.median(np.diff(angles_deg)))
    middle = (angles_deg[:-2] + angles_deg[2:]) / 2
    apart = angles_deg[2:] - angles_deg[:-2]
    far = np.abs(angles_deg[1:-1] - middle) > MAX_STEPS_OUT_OF_LINE * abs(step)
    off = np.flatnonzero(far & (np.abs(apart - 2 * step) < 0.5 * abs(step))) + 1
    if step == 0 or len(off) == 0:
        return []
    k = int(off[0])
    around = ", ".join(f"{a:g}" for a in angles_deg[k - 1 : k + 2])
    fact = f"the angle of view {k}, {angles_deg[k]:g} degrees, is far from those of its neighbours"
    remedy = "correct it if it is a misprint"
    return [Finding(Level.WARNING, ANGLE_TABLE, where, fact, f"{around}; steps of {step:g}", remedy)]
