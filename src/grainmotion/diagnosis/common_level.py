"""A beam that is dimmer than in the flats by one factor in all views, where it makes the views contradict each other.

The level of the beam by view counts from zero if the flats were taken with that beam; a level of all views alike may be
a container that fills the panel.  Only if the views agree without it, it is none.
"""

from __future__ import annotations

import numpy as np

from grainmotion.diagnosis.read_scan import border_width, borders
from grainmotion.diagnosis.rival_geometries import Rivals, Tried
from grainmotion.diagnosis.settings import CheckSettings
from grainmotion.model.finding import Finding, Level
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume

MIN_COMMON_LEVEL = 0.03
"""Line integral at the sides of the panel from which it is tried."""
ALIKE = 0.1
"""Largest spread of the sides over that level, of the views and of left and right."""
MAX_LEFT = 0.5
"""Share of the judged residual that may be left without the level: flats of three times the exposure kept 0.13, darks
subtracted twice 0.3."""


def common_level_findings(
    scan: Scan, grid: Volume, nominal: Tried, settings: CheckSettings, where: str
) -> tuple[Finding, ...]:
    """A finding if the views agree once one level is taken off all of them."""
    sides = np.stack(
        [
            np.median(scan.line_integrals[:, :, part], axis=(1, 2))
            for part in borders(border_width(scan.geometry.shape[1]))
        ]
    )
    level = float(np.median(sides))
    if level < MIN_COMMON_LEVEL or np.abs(sides - level).max() > ALIKE * level:
        return ()
    lowered = Rivals(scan.levelled(np.full(len(scan), level)), grid)
    then = lowered.tried(()) if nominal.shift else lowered.as_given()
    before, after = nominal.consistency.judged, then.consistency.judged
    if after > MAX_LEFT * before:
        return ()
    fact = (
        f"the radiographs are darker than the flats by a factor of {np.exp(level):.2f} at both sides of the panel, in "
    )
    fact += (
        "all views alike, and the views contradict each other; without it they agree: flats of another exposure, or "
    )
    fact += "darks that are subtracted already"
    evidence = f"half of the views against the other half leaves {before:.3f}, {after:.3f} then"
    remedy = f"give flats and darks of this scan; if the sides see only air, {where}.air = {{ margin = 2 }} does it"
    grade = Level.ERROR if before > settings.stop else Level.WARNING
    return (Finding(grade, "beam-level", where, fact, evidence, remedy),)
