"""Size of the grains in a later state: how much larger or smaller they should be, about their own centres.

Motions can take up a wrong place of a grain, not a wrong size.  So after tracking, the size tells whether the voxels of
the reference volume and the distances of the state's radiographs belong together.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from grainmotion.model.finding import Check, Finding, Level
from grainmotion.model.grains import Grain, GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.projection.grains import simulate_radiographs

SCALE_CHECK: Check = "grain-scale"
TRIED_SCALES = (0.98, 1.0, 1.02)
"""Sizes of the grains whose residuals give a parabola."""
MIN_GRAINS_FOR_SCALE = 3
"""Grains with a motion."""
MAX_SIZE_ERROR = 0.01
"""Error of the size from which it is told: 28 scans with the right voxels gave up to 0.0022 (0.007 on binned panels),
2 % too large voxels 0.018.
"""
MAX_RESIDUAL_OF_SIZES = 0.3
"""Relative residual up to which a size is believed."""
SIZE_IS_BETTER = 0.95
"""Least residual over that with the given size, from which it is told: 0.99 and more with the right voxels, 0.73 with
2 % too large ones.
"""


def check_scale(grains: GrainSet, motions: Motions, scan: Scan, where: str = "state") -> tuple[Finding, ...]:
    """A finding if the grains are clearly larger or smaller in the radiographs than in the reference.

    Parameters
    ----------
    grains : GrainSet
        As tracked.
    motions : Motions
        One a grain.
    scan : Scan
        Radiographs of the state.
    where : str
        Key of the state, for the finding.

    Returns
    -------
    tuple of Finding
        At most one.
    """
    size, residual, least = grain_scale(grains, motions, scan)
    if abs(size - 1) < MAX_SIZE_ERROR or least > MAX_RESIDUAL_OF_SIZES or least > SIZE_IS_BETTER * residual:
        return ()
    volume = grains.grains[0].volume
    larger = "larger" if size > 1 else "smaller"
    fact = (
        f"the grains are {abs(size - 1):.1%} {larger} in the radiographs than in the volume: "
        "wrong voxels of the volume or distances of the radiographs"
    )
    evidence = f"relative residual {residual:.3f}, and {least:.3f} with that size"
    remedy = f"give volume.voxel_size = {size * volume.voxel_size:.4g}, or correct the distances; u is wrong by as much"
    return (Finding(Level.WARNING, SCALE_CHECK, where, fact, evidence, remedy),)


def grain_scale(grains: GrainSet, motions: Motions, scan: Scan) -> tuple[float, float, float]:
    """Size of the grains with the least residual, the residual with the given size, and the least one.

    Parameters
    ----------
    grains : GrainSet
        As tracked.
    motions : Motions
        One a grain.
    scan : Scan
        Radiographs of the state.

    Returns
    -------
    (float, float, float)
        Size 1 where it is unknown; relative residuals after one gain for all views.
    """
    if np.count_nonzero(np.isfinite(motions.translations).all(axis=1)) < MIN_GRAINS_FOR_SCALE:
        return 1.0, 0.0, 0.0
    good = slice(None) if scan.valid is None else scan.valid
    measured = scan.line_integrals[good].astype(float)
    squares = []
    for scale in TRIED_SCALES:
        simulated = simulate_radiographs(_scaled(grains, scale), motions, scan.geometry)[good].astype(float)
        gain = float((simulated * measured).sum() / max((simulated**2).sum(), np.finfo(float).tiny))
        squares.append(float(((measured - gain * simulated) ** 2).sum() / (measured**2).sum()))
    bend, slope, at_one = np.polyfit(np.log(TRIED_SCALES), squares, 2)
    if bend <= 0:
        return 1.0, float(np.sqrt(squares[1])), float(np.sqrt(squares[1]))
    best = float(-slope / (2 * bend))
    least = max(float(at_one - slope**2 / (4 * bend)), 0.0)
    return float(np.exp(np.clip(best, -0.1, 0.1))), float(np.sqrt(squares[1])), float(np.sqrt(least))


def _scaled(grains: GrainSet, scale: float) -> GrainSet:
    return GrainSet(tuple(_scaled_grain(g, scale) for g in grains.grains), grains.background, grains.background_moves)


def _scaled_grain(grain: Grain, scale: float) -> Grain:
    """A grain larger by a factor about its centre of mass."""
    fine = None if grain.fine is None else _scaled_volume(grain.fine, grain, scale)
    return replace(grain, volume=_scaled_volume(grain.volume, grain, scale), fine=fine)


def _scaled_volume(volume: Volume, grain: Grain, scale: float) -> Volume:
    x, y, z = grain.center + scale * (np.array(volume.center) - grain.center)
    return replace(volume, voxel_size=scale * volume.voxel_size, center=(x, y, z))
