"""Grains that no rigid motion explains because they are strained: found without solving for strains.

Where residuals are above the noise, one step of motions and strains together shows how much of them strains would
explain.  What it changes in the motions is the error that the strain causes, and becomes a part of their covariance.
A strain of 5 % in grains of 20 voxels turns their best rigid motions by 1.5 degrees and moves them by 0.07 voxel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float
from grainmotion.model.pose import Pose
from grainmotion.objective.evaluation import Evaluation
from grainmotion.objective.residual import StateProblem
from grainmotion.projection.grain_arrays import planar
from grainmotion.uncertainty.covariance import noise_variances
from grainmotion.uncertainty.likely_strains import StrainStep, strain_step

MIN_RESIDUAL_OVER_NOISE = 1.5
"""Squared residual in a grain's shadow over the noise there, from which strains are looked for: 1.6 to 3.6 in clean
experiments, 1.9 to 3.3 where grains are strained by 1 %, 3.8 to 8 by 5 %.  Below it noise is all that is left."""
MIN_EXPLAINED_FOR_SD = 0.2
"""Share of a grain's residual that the step explains, from which its standard deviations hold the step: up to 0.17 in
clean experiments and with a wall, inclusions and a polychromatic beam, 0.15 to 0.55 with strong beam hardening."""
MIN_EXPLAINED_OF_MANY_FOR_SD = 0.12
"""Median over the sample of that share, from which the standard deviations of all grains hold the step whose own share
is at least half of it: 0.02 to 0.10 in experiments without strain, 0.15 to 0.20 where grains are strained by 0.5 %."""
MIN_EXPLAINED, MIN_STRAIN = 0.7, 0.015
"""Share explained, and principal strain, from which a grain is deformed: 0.87 to 0.92 where it is strained by 5 %."""
MIN_EXPLAINED_OF_MANY, MIN_STRAIN_OF_MANY = 0.48, 0.02
"""Medians over the sample of the share explained, and of the principal strain, from which a note says that grains may
be strained.  0.59 and 0.029 with grains strained by 3 % between pistons, whose shadows leave more noise (2 views: 0.58
and 0.030); 0.17 and 0.017 with strong beam hardening (2 views: 0.39 and 0.022)."""
MAX_GRAINS_TESTED = 2000
"""Grains up to which strains are looked for: derivatives by strain double the memory of a fit."""


@dataclass(frozen=True, eq=False)
class Deformations:
    """Strained grains: which ``deformed (n,)`` are, why ``reasons``, and ``covariances (n, 6, 6)`` to be added.

    ``notes`` tell of strains that are likely in the sample though in no single grain certain.
    """

    deformed: NDArray[np.bool_]
    reasons: tuple[str, ...]
    covariances: Float
    notes: tuple[str, ...] = ()

    @classmethod
    def none(cls, count: int) -> Deformations:
        """No grain is strained."""
        return cls(np.zeros(count, dtype=bool), ("",) * count, np.zeros((count, 6, 6)))

    @classmethod
    def by_step(cls, step: StrainStep, trusted: NDArray[np.bool_]) -> Deformations:
        """What a step means for the ``trusted (n,)`` grains, which are in their places."""
        deformed = trusted & (step.explained > MIN_EXPLAINED) & (step.principal > MIN_STRAIN)
        usual = float(np.median(step.explained[trusted])) if trusted.any() else 0.0
        least = usual / 2 if usual > MIN_EXPLAINED_OF_MANY_FOR_SD else MIN_EXPLAINED_FOR_SD
        held = trusted & (step.explained > min(least, MIN_EXPLAINED_FOR_SD))
        motions = np.where(held[:, None], step.motions, 0.0)
        reasons = tuple(
            f"no rigid motion explains its radiographs: a strain of {strain:.1%} would explain {share:.0%} of its "
            "residual; set [track] strain = true to measure it, or check its label"
            if flag
            else ""
            for flag, strain, share in zip(deformed, step.principal, step.explained, strict=True)
        )
        return cls(deformed, reasons, motions[:, :, None] * motions[:, None, :], _notes(step, trusted & ~deformed))


def _notes(step: StrainStep, undecided: NDArray[np.bool_]) -> tuple[str, ...]:
    """A sentence if strains are likely in most of the sample, of the ``undecided (n,)`` grains."""
    if undecided.mean() < 0.5:
        return ()
    share, strain = float(np.median(step.explained[undecided])), float(np.median(step.principal[undecided]))
    if share < MIN_EXPLAINED_OF_MANY or strain < MIN_STRAIN_OF_MANY:
        return ()
    return (
        f"grains may be strained: strains of {strain:.1%} would explain {share:.0%} of their residuals (medians), and "
        "standard deviations hold the errors that they would cause; try [track] strain = true, and check for beam "
        "hardening, which can look alike",
    )


def find_deformations(
    problem: StateProblem, pose: Pose, evaluation: Evaluation, misregistered: NDArray[np.bool_]
) -> Deformations:
    """The strained grains of a solution of rigid motions, among those that are in their places."""
    n, trusted = len(problem.grains), ~misregistered
    none = Deformations.none(n)
    if problem.grains.stretches is not None or n > MAX_GRAINS_TESTED or trusted.mean() < 0.5:
        return none
    if planar(problem.grains, problem.target.scan.geometry):
        return none
    if not (trusted & (_residual_over_noise(problem, evaluation) > MIN_RESIDUAL_OVER_NOISE)).any():
        return none
    return Deformations.by_step(strain_step(problem, pose), trusted)


def _residual_over_noise(problem: StateProblem, evaluation: Evaluation) -> Float:
    """Squared residual over the variance of the noise in each grain's shadow, ``(n,)``."""
    images = problem.target.trust, evaluation.raw_residual, noise_variances(problem.target, evaluation)
    sums = np.zeros((len(problem.grains), 2))
    for grain, own, (good, residual, variance) in evaluation.grain_pixels(*images):
        weight = np.abs(own) * good
        sums[grain] += weight @ residual.astype(float) ** 2, weight @ variance
    return sums[:, 0] / np.maximum(sums[:, 1], 1e-300)
