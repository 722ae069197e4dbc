"""How well each grain fits, and which do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from grainmotion.packed import Pose
from grainmotion.project import assemble
from grainmotion.scan import Scan
from grainmotion.tracking.residual import Glance, StateProblem

Float = NDArray[np.float64]
FEW = 4.0
"""Grains on a ray, this one among them, up to which only its own line integrals count."""
LEAST, USUAL = 0.08, 0.05
"""Shares of a grain's line integrals: the least misfit, and the most that the sample's usual one counts."""


def grain_residuals(problem: StateProblem, seen: Glance) -> tuple[Float, Float]:
    """Root mean square of b − m(P) over each grain's shadow, and of its own line integrals there, ``(n,)`` each.

    Pixels are weighted by the grain's own line integral, so that its core counts and its rim does not.  Where many
    grains overlap, the small misfits of all of them add up, in squares: beyond `FEW` as strong as the grain itself
    these count as its line integrals do.
    """
    n = len(problem.grains)
    crowd = assemble(seen.values**2, seen.patches, problem.target.scan.geometry) / FEW
    sums = np.zeros((n, 3))
    for p, (grain, view, r0, r1, c0, c1) in enumerate(seen.patches.boxes):
        start, end = seen.patches.offsets[p : p + 2]
        own = seen.values[start:end].astype(float)
        residual = seen.raw[view, r0:r1, c0:c1].ravel()
        around = crowd[view, r0:r1, c0:c1].ravel()
        weight = np.abs(own) * problem.target.valid[view, r0:r1, c0:c1].ravel()
        sums[grain] += weight.sum(), weight @ residual.astype(float) ** 2, weight @ np.maximum(own**2, around)
    mass = np.maximum(sums[:, :1], 1e-30)
    both = np.sqrt(sums[:, 1:] / mass)
    both[sums[:, 0] <= 0] = np.nan
    # a small gain would make any misfit small beside line integrals that nobody measured
    return both[:, 0], both[:, 1] * float(np.clip(seen.response.gain, 0.0, 1.0))


def misfits(residuals: Float, paths: Float, noise: float) -> NDArray[np.bool_]:
    """Grains whose residual beyond the noise is too large a share of their line integrals, ``(n,)``.

    Grains in their places leave 0.01 to 0.05 (voxels against sharp surfaces, 45 to 20 voxels across), grains in
    wrong ones 0.15 to 0.4.  ``residuals`` and ``paths`` are those of `grain_residuals`, ``noise`` of `noise_level`.
    """
    share = shares(residuals, paths, noise)
    known = np.isfinite(share)
    usual = float(np.median(share[known])) if known.any() else 0.0
    return ~known | (share > max(LEAST, 2.5 * min(usual, USUAL)))


def shares(residuals: Float, paths: Float, noise: float) -> Float:
    """Each grain's residual beyond the noise, as a share of its line integrals, ``(n,)``."""
    with np.errstate(invalid="ignore", divide="ignore"):
        found: Float = np.sqrt(np.maximum(residuals**2 - noise**2, 0)) / paths
    return found


def noise_level(scan: Scan) -> float:
    """Noise of a pixel: robust spread of second differences along rows, which smooth shadows do not have."""
    images = scan.line_integrals
    if images.shape[2] < 3:
        return 0.0
    second = images[:, :, 2:] - 2 * images[:, :, 1:-1] + images[:, :, :-2]
    return float(1.4826 * np.median(np.abs(second)) / np.sqrt(6))


def lost_grains(problem: StateProblem, pose: Pose) -> NDArray[np.bool_]:
    """Grains that some view sees and that fit badly at a pose, pixel by pixel, ``(n,)``."""
    seen = problem.glance(pose)
    residuals, paths = grain_residuals(problem, seen)
    return misfits(residuals, paths, noise_level(problem.target.scan)) & (seen.patches.seen.mean(axis=1) > 0)


def evened(problem: StateProblem, pose: Pose) -> Scan:
    """The radiographs as a perfect detector would show them, so that one grain can be fitted alone."""
    seen, scan = problem.glance(pose), problem.target.scan
    gains = seen.response.polynomial[:, 0]
    if not ((gains > 0.5) & (gains < 2)).all():  # no beam drifts so far: what was fitted is not a gain
        return scan
    return replace(scan, line_integrals=seen.path + seen.raw / np.maximum(seen.response.slope(seen.path), 0.1))
