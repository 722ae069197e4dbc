"""Directions that a full scan leaves out: a scan of less than half a turn."""

from __future__ import annotations

import numpy as np

from grainmotion.diagnosis.hypotheses import stage_angles_deg
from grainmotion.model.finding import Finding, Level
from grainmotion.model.geometry import Geometry

MAX_DIRECTIONS_LEFT_OUT_DEG = 15.0
"""Largest gap between neighbouring directions, modulo 180°, that is not told."""
MAX_STEPS_LEFT_OUT = 3.0
"""Gap between neighbouring directions over the median, up to which it is due to few views."""


def missing_directions(geometry: Geometry, where: str) -> tuple[Finding, ...]:
    """A warning if the views of a scan leave out directions; a view from behind is of the same direction."""
    directions = np.sort(stage_angles_deg(geometry) % 180)
    gaps = np.diff(directions, append=directions[0] + 180)
    gap = float(gaps.max())
    if gap < max(MAX_DIRECTIONS_LEFT_OUT_DEG, MAX_STEPS_LEFT_OUT * float(np.median(gaps[gaps > 1e-6]))):
        return ()
    first = directions[int(gaps.argmax())]
    fact = f"the scan leaves out directions over {gap:.0f} degrees: grains are smeared along them in the reconstruction"
    evidence = f"no view between {first:.0f} and {first + gap:.0f} degrees, nor from behind"
    remedy = "turn the stage by 180 degrees at least in the full scan, or check angles_deg"
    return (Finding(Level.WARNING, "reference-geometry", where, fact, evidence, remedy),)
