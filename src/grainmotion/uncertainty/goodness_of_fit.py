"""How well each grain fits, and which do not."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float
from grainmotion.model.pose import Pose
from grainmotion.model.scan import Scan
from grainmotion.objective.residual import Evaluation, StateProblem
from grainmotion.projection.grains import assemble
from grainmotion.uncertainty.noise_model import noise_level

LEAST, USUAL = 0.08, 0.05
"""Shares of a grain's line integrals: the least misfit, and the most that the sample's usual one counts."""
TIMES = 2.5
"""Times the usual misfit that a grain must leave to be lost."""
VARIES = 2.0
"""Times the usual misfit's square that all others on a grain's rays may leave together."""


@dataclass(frozen=True, eq=False)
class Misfits:
    """What is left of the radiographs where the grains are, ``(n,)`` each, as root mean squares.

    Attributes
    ----------
    residuals : array
        b − m(P) over each grain's shadow; NaN where no view sees it.
    paths : array
        Its own line integrals there.
    crowds : array
        √ΣP² there, of all grains on a ray: their small misfits add up in squares.
    noise : float
        Of a pixel, see `noise_level`.
    """

    residuals: Float
    paths: Float
    crowds: Float
    noise: float

    @property
    def usual(self) -> float:
        """The misfit that grains of this sample have, as a share of their line integrals."""
        known = self._in_crowd[np.isfinite(self._in_crowd)]
        return min(float(np.median(known)), USUAL) if len(known) else 0.0

    @property
    def shares(self) -> Float:
        """Each grain's misfit beyond the noise and beyond what others on its rays leave, over its line integrals."""
        others = np.maximum(self.crowds**2 - self.paths**2, 0)
        with np.errstate(invalid="ignore", divide="ignore"):
            own = np.maximum(self._beyond_noise - VARIES * self.usual**2 * others, 0)
            return np.asarray(np.sqrt(own) / self.paths)

    @property
    def lost(self) -> NDArray[np.bool_]:
        """Grains whose misfit is too large a share of their line integrals, or unknown.

        Grains in their places leave 0.01 to 0.05 (voxels against sharp surfaces, 45 to 20 voxels across), grains in
        wrong ones 0.15 to 0.4.
        """
        shares = self.shares
        return ~np.isfinite(shares) | (shares > max(LEAST, TIMES * self.usual))

    @property
    def astray(self) -> NDArray[np.bool_]:
        """Lost ones that leave much beside all line integrals on their rays, too.

        Early on no grain is in its place to a fraction of a voxel, and what all in a crowd leave would hide, or feign,
        a lost one; this tells whether they are near.
        """
        in_crowd = self._in_crowd
        return self.lost & (~np.isfinite(in_crowd) | (in_crowd > TIMES * USUAL))

    @property
    def _in_crowd(self) -> Float:
        """Misfit beyond the noise over the line integrals of all grains on the rays."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(np.sqrt(self._beyond_noise) / self.crowds)

    @property
    def _beyond_noise(self) -> Float:
        return np.maximum(self.residuals**2 - self.noise**2, 0)


def misfits(problem: StateProblem, seen: Evaluation) -> Misfits:
    """How well each grain fits, pixel by pixel.

    Pixels are weighted by the grain's own line integral, so that its core counts and its rim does not.
    """
    n = len(problem.grains)
    values = np.asarray(seen.values)
    squares = assemble(values**2, seen.patches, problem.target.scan.geometry)
    sums = np.zeros((n, 4))
    for p, (grain, view, r0, r1, c0, c1) in enumerate(seen.patches.boxes):
        start, end = seen.patches.offsets[p : p + 2]
        own = values[start:end].astype(float)
        residual, all_there = (images[view, r0:r1, c0:c1].ravel().astype(float) for images in (seen.raw, squares))
        weight = np.abs(own) * problem.target.valid[view, r0:r1, c0:c1].ravel()
        sums[grain] += weight.sum(), weight @ residual**2, weight @ own**2, weight @ all_there
    means = np.sqrt(sums[:, 1:] / np.maximum(sums[:, :1], 1e-30))
    means[sums[:, 0] <= 0] = np.nan
    # a small gain would make any misfit small beside line integrals that nobody measured
    means[:, 1:] *= float(np.clip(seen.response.gain, 0.0, 1.0))
    residuals, paths, crowds = means.T
    return Misfits(residuals, paths, crowds, noise_level(problem.target.scan))


def lost_grains(problem: StateProblem, pose: Pose) -> NDArray[np.bool_]:
    """Grains that some view sees and that fit badly at a pose, pixel by pixel, ``(n,)``."""
    seen = problem.glance(pose)
    return misfits(problem, seen).lost & (seen.patches.seen.mean(axis=1) > 0)


def evened(problem: StateProblem, pose: Pose) -> Scan:
    """The radiographs as a perfect detector would show them, so that one grain can be fitted alone."""
    seen, scan = problem.glance(pose), problem.target.scan
    gains = seen.response.polynomial[:, 0]
    if not ((gains > 0.5) & (gains < 2)).all():  # no beam drifts so far: what was fitted is not a gain
        return scan
    return replace(scan, line_integrals=seen.path + seen.raw / np.maximum(seen.response.slope(seen.path), 0.1))
