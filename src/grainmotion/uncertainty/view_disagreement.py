"""Model error by what the views ask of a grain: factors on its variances.

At a solution the scores of a grain, s_v = J_vᵀ r of each view, add up to zero over the views, but each is as large as
its errors: a view that is out of place, blurred, hardened, or shows a grain that is no rigid copy of the reference,
asks for another motion than the other views do.  Scores weigh the residual as the estimate does, so whatever is
correlated over pixels counts as it counts in the errors, and no correlation need be modelled.  With s H_v⁻¹ s summed
over views, its mean E for the variances of the pixels and its mean for noise alone,

    factor = 1 + (Σ s H_v⁻¹ s − mean for noise) / E.

Noise is taken off because the fit's own variances are a model of it and of the model error that all views share.
Sums are over all grains, for translations and for rotations apart, and over each grain as far as its few numbers show
more than that.  Decision 0036 has the figures.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float, Index
from grainmotion.model.progress import reached
from grainmotion.objective.data_term import Target
from grainmotion.objective.evaluation import LinearizedEvaluation
from grainmotion.objective.global_parameters import Columns
from grainmotion.projection.jacobian import PatchJacobian
from grainmotion.uncertainty.noise_draws import NoiseDraws, drawn_noise

SAMPLE_WEIGHT = 15.0
"""Degrees of freedom that the sample's factor counts for beside a grain's own: 4 views give a grain 6 of translations
and 8 of rotations, 2 views 1 and 2.5."""
COMMON_WEIGHT = 20.0
"""Degrees of freedom that the factor of translations and rotations together counts for beside that of each."""
PRIOR_FREEDOM = 2.0
"""Degrees of freedom without disagreement that a sample is given, so that one grain in two views shows little."""
MAX_RATIO_OVER_MEDIAN = 4.0
"""Times the median of all grains, up to which a grain's squares over their mean count for the sample: one that is cut,
broken or strained among whole ones says nothing about these.  Of 6 grains in 2 views one in 60 exceeds it by chance."""
MIN_VIEW_EIGENVALUE = 1e-3
"""Eigenvalue of a view's information, scaled to a unit diagonal, below which a direction (the depth) does not count."""
NOISE_SEED = 1
"""Of the draws of noise alone; those of all variances have another."""


@dataclass(frozen=True, eq=False)
class Disagreement:
    """Squares of the scores of each row of six unknowns, in two halves, ``(rows, 2)`` each.

    ``found`` are those of the residual, ``expected`` the mean for the variances of the pixels and ``of_noise`` that
    for noise alone.
    """

    found: Float
    expected: Float
    of_noise: Float

    def factors(self, trusted: NDArray[np.bool_]) -> Float:
        """Factors on the variances ``(rows, 2)``, at least 1; the sample's are those of ``trusted (rows,)`` rows."""
        own = self.found - self.of_noise
        ratios = self.found.sum(axis=1) / np.maximum(self.expected.sum(axis=1), 1e-300)
        some = trusted if trusted.any() else np.ones_like(trusted)
        some = some & (ratios <= MAX_RATIO_OVER_MEDIAN * np.median(ratios[some]))
        excess, freedom = own[some].sum(axis=0), self.expected[some].sum(axis=0)
        common = max(excess.sum() / (freedom.sum() + PRIOR_FREEDOM), 0.0)
        sample = (excess + COMMON_WEIGHT * common) / (freedom + COMMON_WEIGHT + PRIOR_FREEDOM)
        sample = np.maximum(sample, 0.0)
        each = (own + SAMPLE_WEIGHT * sample) / (self.expected + SAMPLE_WEIGHT)
        return 1.0 + np.maximum(each, sample)


def disagreement(
    target: Target, evaluation: LinearizedEvaluation, columns: Columns, draws: NoiseDraws, noise_variances: Float
) -> Disagreement:
    """What the views ask of each row of six unknowns of a fit.

    ``draws`` are of all variances of the pixels, ``noise_variances`` are those of noise alone.
    """
    jacobian = evaluation.jacobian
    count = len(jacobian.patches.boxes)
    information = jacobian.gram_blocks(np.repeat(np.arange(count), 2).reshape(-1, 2), np.arange(count + 1))
    measure = _Measure.of(information, jacobian.patches.boxes[:, 0], len(jacobian))
    drawn = np.maximum(measure.squares(draws.scores), 1e-300)
    unit = drawn / np.maximum(measure.directions, 1)  # of a variance: squares count degrees of freedom then
    found = measure.squares(jacobian.vjp([evaluation.residual])) / unit
    expected = measure.squares(draws.left_scores(jacobian, columns)) / unit
    noise = measure.squares(_noise_scores(target, jacobian, noise_variances))
    return Disagreement(found, expected, noise / drawn * expected)


def _noise_scores(target: Target, jacobian: PatchJacobian, variances: Float) -> Float:
    """Jᵀ of noise alone, ``(K, patches, 6)``."""
    return jacobian.vjp(drawn_noise(target, variances, NOISE_SEED).stacks)


@dataclass(frozen=True, eq=False)
class _Measure:
    """Squares of scores in the units of each view's information.

    Those of the last three unknowns are taken with the first three eliminated.  ``directions (rows, 2)`` are how many
    of them the views of a row determine in all.
    """

    first: Float
    last: Float
    elimination: Float
    directions: Float
    rows: Index
    count: int

    @classmethod
    def of(cls, information: Float, rows: Index, count: int) -> _Measure:
        first, of_first = _inverse(information[:, :3, :3])
        across = information[:, 3:, :3] @ first
        complement = information[:, 3:, 3:] - across @ information[:, :3, 3:]
        elimination = np.concatenate([-across, np.broadcast_to(np.eye(3), across.shape)], axis=2)
        last, of_last = _inverse(complement)
        directions = np.zeros((count, 2))
        np.add.at(directions, rows, np.stack([of_first, of_last], axis=1))
        return cls(first, last, elimination, directions, rows, count)

    def squares(self, scores: Float) -> Float:
        """Means over k draws of the sums over each row's patches, of ``scores (k, patches, 6)``: ``(rows, 2)``."""
        reached(0.0)  # of 100,000 patches these products take a second
        last = np.einsum("pij,kpj->kpi", self.elimination, scores)
        each = [
            np.einsum("kpi,pij,kpj->p", s, inverse, s) / len(scores)
            for s, inverse in ((scores[..., :3], self.first), (last, self.last))
        ]
        out = np.zeros((self.count, 2))
        np.add.at(out, self.rows, np.stack(each, axis=1))
        return out


def _inverse(matrices: Float) -> tuple[Float, Index]:
    """Inverses in the directions that a view determines, zero along the others, and how many these are."""
    diagonals = np.diagonal(matrices, axis1=1, axis2=2)
    scale = np.where(diagonals > 0, 1 / np.sqrt(np.where(diagonals > 0, diagonals, 1.0)), 0.0)
    scales = scale[:, :, None] * scale[:, None, :]
    values, vectors = np.linalg.eigh(matrices * scales)
    determined = values > MIN_VIEW_EIGENVALUE
    inverses = np.where(determined, 1 / np.maximum(values, MIN_VIEW_EIGENVALUE), 0.0)
    return scales * ((vectors * inverses[:, None, :]) @ np.swapaxes(vectors, 1, 2)), determined.sum(axis=1)
