"""A few of many grains alone: the same problem with all others fixed where they are.

Where few grains of a large sample still move, or fit badly, a step of all of them costs a hundred times what those few
cost.  The images of the others are added up once.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from grainmotion.backends.cpu import CPU
from grainmotion.model.pose import Pose
from grainmotion.objective.nuisance_motions import corrected_geometry
from grainmotion.objective.residual import StateProblem
from grainmotion.projection.footprints import footprint_patches
from grainmotion.projection.grains import assemble, project_in_place, project_patches
from grainmotion.solvers.block_cg import MAX_DENSE_UNKNOWNS
from grainmotion.solvers.gauss_newton import Solution

MIN_GRAINS_IN_PARTS = MAX_DENSE_UNKNOWNS // 6 + 1
"""Grains from which a few of them are solved for alone: those that have no dense normal matrix."""
NEIGHBOUR_DIAMETERS = 1.5
"""Distance between centres, in median diameters, up to which a grain may have made up for a misplaced one."""


def freed(problem: StateProblem, pose: Pose, rows: NDArray[np.int64]) -> tuple[StateProblem, Pose]:
    """The problem of the grains of ``rows`` with the others fixed at ``pose``, and the pose of these; no prior."""
    grains, target = problem.grains, problem.target
    geometry = corrected_geometry(target.scan.geometry, pose.nuisance)
    patches = footprint_patches(grains, pose, geometry)
    values = project_in_place(grains, pose, geometry, patches, target.projector)
    others = assemble(values, patches, geometry, grains.backend)
    some = replace(grains.select(rows), backend=CPU, placed=None)  # few: the processor has them at once
    at = pose.moved(pose.translations[rows], pose.matrices[rows])
    patches = footprint_patches(some, at, geometry)
    others -= assemble(project_patches(some, at, geometry, patches, target.projector), patches, geometry)
    return StateProblem(some, replace(target, fixed_background=target.fixed_background + others)), at


def merged(pose: Pose, some: Pose, rows: NDArray[np.int64]) -> Pose:
    """The pose of all grains with those of ``rows`` at ``some``."""
    translations, matrices = pose.translations.copy(), pose.matrices.copy()
    translations[rows], matrices[rows] = some.translations, some.matrices
    return Pose(translations, matrices, some.nuisance)


def placed_among(problem: StateProblem, pose: Pose, end: Solution[Pose], rows: NDArray[np.int64]) -> Solution[Pose]:
    """The solution of the grains of ``rows`` as one of the problem of all grains, the others as at ``pose``."""
    state = merged(pose, end.state, rows)
    step = np.zeros((len(problem.grains), 6))
    step[rows] = end.last_step[: 6 * len(rows)].reshape(-1, 6)
    last_step = np.concatenate([step.ravel(), end.last_step[6 * len(rows) :]])
    return Solution(state, (problem.cost(state),), last_step, end.settled)


def with_neighbours(
    problem: StateProblem, pose: Pose, rows: NDArray[np.int64], diameters: float = NEIGHBOUR_DIAMETERS
) -> NDArray[np.int64]:
    """``rows`` and the grains within so many median diameters of theirs at a pose."""
    places = problem.grains.centers + pose.translations
    reach = diameters * 2 * float(np.median(problem.grains.radii))
    near = cKDTree(places).query_ball_point(places[rows], reach)
    return np.unique(np.concatenate([rows, *near])).astype(np.int64)
