"""Grains of a crowd that fit less well than others and rotated unlike all around them: a good fit is no proof there.

Of thousands of grains behind each other, neighbours can make up for a misplaced one so far that its misfit is no longer
too large.  Of 10,000 grains three were turned by 44 to 106 degrees from their true poses.  Their misfits were 0.039 to
0.068 of their line integrals, where 0.08 is too large and 31 grains exceeded 0.036; and they rotated 32 standard
deviations or more away from the median of their neighbours, all others less than 6.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from grainmotion.model.motions import Motions, Status
from grainmotion.model.pose import Pose
from grainmotion.objective.evaluation import Evaluation
from grainmotion.objective.residual import StateProblem
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.rotations import rotation_vector
from grainmotion.tracking.few_grains import MIN_GRAINS_IN_PARTS
from grainmotion.uncertainty.goodness_of_fit import MIN_MISFIT, Misfits, misfits

COMPARED_NEIGHBOURS = 12
"""Nearest grains with which one is compared."""
DOUBTFUL_SHARE = 0.45
"""Share of the least misfit of a misregistered grain from which one is doubtful."""
MIN_ODD_SD, MIN_ODD_ANGLE = 8.0, np.deg2rad(15)
"""Robust standard deviations of all grains, and radians, by which a doubtful grain rotated unlike its neighbours."""

UNLIKE_REASON = (
    "it rotated unlike all grains around it and fits less well than most, so its place may be wrong; take more views, "
    "or give a nearer start"
)


def with_unlike_neighbours(motions: Motions, problem: StateProblem, pose: Pose, evaluation: Evaluation) -> Motions:
    """The motions; grains that converged unlike their neighbours and fit less well are not trusted."""
    if len(problem.grains) < MIN_GRAINS_IN_PARTS:
        return motions
    doubtful = motions.ok & unlike_neighbours(problem.grains, pose, misfits(problem, evaluation))
    statuses, trusted = motions.statuses.copy(), ~doubtful
    statuses[doubtful] = Status.NOT_CONVERGED.value
    return replace(
        motions,
        statuses=statuses,
        reasons=tuple(UNLIKE_REASON if odd else reason for odd, reason in zip(doubtful, motions.reasons, strict=True)),
        ok_translation=motions.ok_translation & trusted,
        ok_rotation=motions.ok_rotation & trusted,
    )


def unlike_neighbours(grains: GrainArrays, pose: Pose, fits: Misfits) -> NDArray[np.bool_]:
    """Grains ``(n,)`` that fit less well than others and rotated unlike those around them."""
    rotations = rotation_vector(pose.matrices)
    near = np.asarray(cKDTree(grains.centers).query(grains.centers, COMPARED_NEIGHBOURS + 1)[1])[:, 1:]
    odd = np.linalg.norm(rotations - np.median(rotations[near], axis=1), axis=1)
    usual = np.median(odd)
    spread = 1.4826 * np.median(np.abs(odd - usual))
    far = odd > max(usual + MIN_ODD_SD * spread, MIN_ODD_ANGLE)
    return np.asarray(far & (fits.shares > DOUBTFUL_SHARE * MIN_MISFIT))
