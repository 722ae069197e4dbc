"""Goodness of fit of each grain, and which grains are misregistered."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float, Image
from grainmotion.model.pose import Pose
from grainmotion.model.scan import Scan
from grainmotion.model.task_map import each_at_hand
from grainmotion.objective.evaluation import Evaluation
from grainmotion.objective.residual import StateProblem
from grainmotion.projection.grains import assemble
from grainmotion.uncertainty.noise_model import pixel_variances

MIN_MISFIT, MAX_USUAL_MISFIT = 0.08, 0.05
"""Shares of a grain's line integrals: the least misfit of a misregistered grain, and the largest misfit that counts as
the sample's usual one."""
MISFIT_OVER_USUAL = 2.5
"""Times the usual misfit from which a grain is misregistered."""
NOISE_SD = 3.0
"""Standard deviations by which the mean square of noise in a grain's footprints may exceed its mean: grains that are
little denser than a liquid around them have line integrals of a few times the noise."""
PATCHES_AT_ONCE = 128
"""Patches whose pixels are looked at in one call, where several processes share them."""
NEIGHBOUR_MISFIT = 2.0
"""Times the square of the usual misfit that all others on a grain's rays may leave together."""


@dataclass(frozen=True, eq=False)
class Misfits:
    """Residuals of the radiographs in the grains' footprints, ``(n,)`` each, as root mean squares.

    Attributes
    ----------
    rms_residuals : array
        b − m(P) over each grain's footprint; NaN where no view sees it.
    rms_line_integrals : array
        The grain's own line integrals there.
    rms_crowd_integrals : array
        √ΣP² there, of all grains on a ray: their small misfits add up in squares.
    noise : array or float
        Of the pixels there; larger behind more attenuation.
    noise_spread : array or float
        Relative standard deviation of the mean square of noise there, by the number of its pixels.
    """

    rms_residuals: Float
    rms_line_integrals: Float
    rms_crowd_integrals: Float
    noise: Float | float
    noise_spread: Float | float = 0.0

    @property
    def usual(self) -> float:
        """The misfit that grains of this sample have, as a share of their line integrals."""
        finite = self._in_crowd[np.isfinite(self._in_crowd)]
        return min(float(np.median(finite)), MAX_USUAL_MISFIT) if len(finite) else 0.0

    @property
    def shares(self) -> Float:
        """Each grain's misfit beyond the noise and beyond what others on its rays leave, over its line integrals."""
        others = np.maximum(self.rms_crowd_integrals**2 - self.rms_line_integrals**2, 0)
        with np.errstate(invalid="ignore", divide="ignore"):
            by_chance = NOISE_SD * self.noise_spread * self.noise**2
            own = np.maximum(self._beyond_noise - by_chance - NEIGHBOUR_MISFIT * self.usual**2 * others, 0)
            return np.asarray(np.sqrt(own) / self.rms_line_integrals)

    @property
    def misregistered(self) -> NDArray[np.bool_]:
        """Grains whose misfit is too large a share of their line integrals, or unknown.

        Grains in their places leave 0.01 to 0.05 (voxels against sharp surfaces, 45 to 20 voxels across), grains in
        wrong ones 0.15 to 0.4.
        """
        shares = self.shares
        return ~np.isfinite(shares) | (shares > max(MIN_MISFIT, MISFIT_OVER_USUAL * self.usual))

    @property
    def misregistered_in_crowd(self) -> NDArray[np.bool_]:
        """Misregistered grains whose misfit is large beside all line integrals on their rays, too.

        Early on all grains are off by fractions of a voxel, and the misfits of a crowd can hide or imitate a
        misregistered grain; this criterion only shows whether all are near.
        """
        in_crowd = self._in_crowd
        return self.misregistered & (~np.isfinite(in_crowd) | (in_crowd > MISFIT_OVER_USUAL * MAX_USUAL_MISFIT))

    @property
    def _in_crowd(self) -> Float:
        """Misfit beyond the noise over the line integrals of all grains on the rays."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(np.sqrt(self._beyond_noise) / self.rms_crowd_integrals)

    @property
    def _beyond_noise(self) -> Float:
        return np.maximum(self.rms_residuals**2 - self.noise**2, 0)


def misfits(problem: StateProblem, evaluation: Evaluation) -> Misfits:
    """How well each grain fits, pixel by pixel.

    Pixels are weighted by the grain's own line integral, so that its core counts and its rim does not, and by the
    discount.
    """
    values, boxes = np.asarray(evaluation.values), evaluation.patches.boxes
    squares = assemble(values**2, evaluation.patches, problem.target.scan.geometry)
    if problem.target.other_squares is not None:
        squares += problem.target.other_squares
    images = problem.target.trust, evaluation.raw_residual, squares, pixel_variances(problem.target, evaluation)
    parts = [range(k, min(k + PATCHES_AT_ONCE, len(boxes))) for k in range(0, len(boxes), PATCHES_AT_ONCE)]
    sums = np.zeros((len(problem.grains), 6))
    for part, found in zip(parts, each_at_hand(partial(_weighted_sums, evaluation, images), parts), strict=True):
        np.add.at(sums, boxes[part.start : part.stop, 0], found)
    total = np.maximum(sums[:, 0], 1e-30)
    means, spread = np.sqrt(sums[:, 1:5] / total[:, None]), np.sqrt(2 * sums[:, 5]) / total
    means[sums[:, 0] <= 0] = np.nan
    # A small gain would make any misfit small beside line integrals that were never measured.
    means[:, 1:3] *= float(np.clip(evaluation.response.gain, 0.0, 1.0))
    residuals, line_integrals, crowds, noise = means.T
    return Misfits(residuals, line_integrals, crowds, noise, spread)


def _weighted_sums(evaluation: Evaluation, images: Sequence[Image], part: range) -> Float:
    """Of some patches the sums ``(k, 6)`` over their pixels from which `misfits` takes the means."""
    found = []
    for _, own, (valid, residual, crowd, variance) in evaluation.grain_pixels(*images, part=part):
        weight, residual = np.abs(own) * valid, residual.astype(float)
        found.append((
            weight.sum(), weight @ residual**2, weight @ own**2, weight @ crowd.astype(float), weight @ variance,
            weight @ weight,
        ))  # fmt: skip
    return np.array(found, dtype=float).reshape(-1, 6)


def misregistered_grains(problem: StateProblem, pose: Pose) -> NDArray[np.bool_]:
    """Misregistered grains at a pose that are on some radiograph, ``(n,)``."""
    evaluation = problem.evaluate(pose)
    return misfits(problem, evaluation).misregistered & (evaluation.patches.seen.mean(axis=1) > 0)


def response_corrected_scan(problem: StateProblem, pose: Pose) -> Scan:
    """The radiographs as a perfect detector would show them, so that one grain can be fitted alone."""
    evaluation, scan = problem.evaluate(pose), problem.target.scan
    gains = evaluation.response.polynomial[:, 0]
    if not ((gains > 0.5) & (gains < 2)).all():  # no beam drifts so far, so the fitted number is not a gain
        return scan
    return replace(scan, line_integrals=evaluation.line_integrals + evaluation.left_path)
