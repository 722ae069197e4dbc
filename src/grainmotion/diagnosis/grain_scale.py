"""Size of the grains in a later state: how much larger or smaller they should be, about their own centres.

Motions can take up a wrong place of a grain, not a wrong size.  So after tracking, the size tells whether the distances
of the state's radiographs are right, and the voxels of a volume from other software.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from grainmotion.model.finding import Check
from grainmotion.model.grains import Grain, GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.scan import Scan
from grainmotion.projection.grains import simulate_radiographs
from grainmotion.projection.volumes import project

SCALE_CHECK: Check = "grain-scale"
SCALE_NOTE = "the grains are"
"""Beginning of the note."""
SIZE_STEP = 0.01
"""Half the span of sizes between which radiographs are differentiated."""
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


def scale_notes(grains: GrainSet, motions: Motions, scan: Scan) -> tuple[str, ...]:
    """A sentence if the grains are clearly larger or smaller in the radiographs than in the reference.

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
    tuple of str
        At most one.
    """
    if min(scan.geometry.shape) < 2:  # one slice: motions and sizes in its plane only
        return ()
    size, residual, least = grain_scale(grains, motions, scan)
    if abs(size - 1) < MAX_SIZE_ERROR or least > MAX_RESIDUAL_OF_SIZES or least > SIZE_IS_BETTER * residual:
        return ()
    larger = "larger" if size > 1 else "smaller"
    voxel = size * grains.grains[0].volume.voxel_size
    return (
        f"{SCALE_NOTE} {abs(size - 1):.1%} {larger} in the radiographs than in the reference, so all distances between "
        f"them are wrong by as much (relative residual {residual:.3f}, and {least:.3f} with that size); correct the "
        f"distances or the pixel size of these radiographs, or a given volume's voxel size, to {voxel:.4g}",
    )


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
    few = np.count_nonzero(np.isfinite(motions.translations).all(axis=1)) < MIN_GRAINS_FOR_SCALE
    if few or grains.scene.fluid is not None:  # a liquid that changes looks as grains of another size do
        return 1.0, 0.0, 0.0
    good = slice(None) if scan.valid is None else scan.valid
    measured = scan.line_integrals[good].astype(float).ravel()
    smaller, larger = (
        simulate_radiographs(_scaled(grains, scale), motions, scan.geometry)[good].astype(float).ravel()
        for scale in (1 - SIZE_STEP, 1 + SIZE_STEP)
    )
    if grains.background is not None:
        background = project(grains.background, scan.geometry)[good].astype(float).ravel()
        smaller, larger = smaller + background, larger + background
    simulated, derivative = (larger + smaller) / 2, (larger - smaller) / (2 * SIZE_STEP)
    norm = max(float(simulated @ simulated), np.finfo(float).tiny)
    gain = float(simulated @ measured) / norm
    derivative = gain * (derivative - float(derivative @ simulated) / norm * simulated)
    r = measured - gain * simulated
    slope, bend = float(derivative @ r), max(float(derivative @ derivative), np.finfo(float).tiny)
    squares, scale = float(r @ r), float(measured @ measured)
    least = np.sqrt(max(squares - slope**2 / bend, 0.0) / scale)
    return 1 + float(np.clip(slope / bend, -0.1, 0.1)), float(np.sqrt(squares / scale)), float(least)


def _scaled(grains: GrainSet, scale: float) -> GrainSet:
    """The grains alone, larger by a factor."""
    return GrainSet(tuple(_scaled_grain(g, scale) for g in grains.grains))


def _scaled_grain(grain: Grain, scale: float) -> Grain:
    """A grain larger by a factor about its centre of mass, on the voxels of the reference."""
    volume = grain.volume
    x, y, z = grain.center + scale * (np.array(volume.center) - grain.center)
    scaled = replace(volume, voxel_size=scale * volume.voxel_size, center=(x, y, z))
    return replace(grain, volume=scaled, fine=None)
