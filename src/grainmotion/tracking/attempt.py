"""One attempt at a state: all stages for the grains of a job, without asking which of them are there."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float, Image, Progress
from grainmotion.backends.base import PatchBackend
from grainmotion.backends.device import Device
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.pose import Pose
from grainmotion.model.progress import detail
from grainmotion.model.scan import Scan
from grainmotion.model.starting_pose import starting_pose
from grainmotion.objective.residual import StateProblem
from grainmotion.solvers.gauss_newton import Solution, gauss_newton
from grainmotion.tracking.ambiguity import settle_ambiguities, with_reasons
from grainmotion.tracking.body_motions import fixed_note, fixed_unless_moved, with_body_edges_discounted
from grainmotion.tracking.classification import classify
from grainmotion.tracking.ellipsoids import Ellipsoid
from grainmotion.tracking.ellipsoids_beside import (
    add_ellipsoids,
    new_grains,
    refitted_beside,
    with_ellipsoids_discounted,
)
from grainmotion.tracking.expected_rotations import RESIDUAL_WHILE_NEAR
from grainmotion.tracking.fluid_fit import FluidTracker
from grainmotion.tracking.global_search import SearchResult, search
from grainmotion.tracking.hardened_response import with_hardening
from grainmotion.tracking.initial_guess import initialise, smooth_fields
from grainmotion.tracking.missing_grains import grain_supports
from grainmotion.tracking.multistage import MAX_SOUGHT, MultistageFit
from grainmotion.tracking.refinement import align_views, refine
from grainmotion.tracking.settings import TrackSettings
from grainmotion.tracking.strain_stages import solve_strained, start_strained
from grainmotion.tracking.unlike_neighbours import with_unlike_neighbours
from grainmotion.uncertainty.goodness_of_fit import misregistered_grains


@dataclass(frozen=True, eq=False)
class Job:
    """Input of one attempt.

    ``new`` are ellipsoids for grains that the reference does not have, ``other_squares`` those of line integrals of
    grains beside these in the sample (see `Target`), and ``most_sought`` how many are sought at once.
    """

    grains: GrainSet
    scan: Scan
    start: Motions | None
    settings: TrackSettings
    progress: Progress | None
    device: Device | PatchBackend | None
    new: tuple[Ellipsoid, ...] = ()
    other_squares: Image | None = None
    most_sought: int = MAX_SOUGHT

    def fit(self) -> MultistageFit:
        """A fit that is about to start."""
        fit = MultistageFit.of(self.grains, self.scan, self.settings, self.progress, self.device)
        fit.target, fit.most_sought = replace(fit.target, other_squares=self.other_squares), self.most_sought
        add_ellipsoids(fit, self.new)
        return fit


@dataclass(frozen=True, eq=False)
class Attempt:
    """Motions, how far the radiographs support each grain ``(n,)``, and the residual radiographs.

    ``new`` are the ellipsoids of new grains as they fit in the end, ``pieces`` the line integrals of broken grains.
    """

    motions: Motions
    supports: Float
    residual: Image | None = None
    new: tuple[Ellipsoid, ...] = ()
    pieces: Image | None = None


@dataclass(frozen=True, eq=False)
class Approach:
    """A fit before any search: all grains free, from the best of the smooth fields.

    ``fields`` are the poses of the smooth fields, ``field_pose`` the last of them or else the start; ``misregistered``
    are the grains that fit badly so far, ``(n,)``; ``fluid`` keeps a liquid up to date, None for a dry sample.
    """

    fit: MultistageFit
    start: Pose
    fields: list[Pose]
    problem: StateProblem
    solution: Solution[Pose]
    misregistered: NDArray[np.bool_]
    fluid: FluidTracker | None = None

    @property
    def field_pose(self) -> Pose:
        return [self.start, *self.fields][-1]


def attempt(job: Job) -> Attempt:
    """All stages for the grains of a job."""
    try:
        return finish(job, approach(job))
    except np.linalg.LinAlgError as error:  # ends one attempt, not the run
        return unsolved(job.grains, error)


def approach(job: Job) -> Approach:
    """The stages before any search."""
    settings, fit = job.settings, job.fit()
    start = starting_pose(job.grains, job.start)
    fluid = FluidTracker.of(fit, job.grains)
    if fluid is not None:
        fluid.search(start)
    if settings.strain:
        start_strained(fit, job.grains, job.start)
    fields = smooth_fields(fit, start) if settings.fields else []
    if fluid is not None and fields:
        fluid.search(fields[-1])
    pose = initialise(fit, start, fields)
    done = 1 if settings.fields and len(settings.filters) > 1 else 0  # the initial guess ends with the first filter
    problem, solution = fit.solve_free(pose, "free", settings.filters[done:], may_pause=fluid is None)
    if fluid is not None:
        problem, solution = fluid.settle(problem, solution)
    misregistered = np.zeros(len(job.grains), dtype=bool)
    if settings.search:
        # the faces of bodies leave a residual that grains before them did not cause
        judged, at = with_body_edges_discounted(fit, problem, solution)
        misregistered = misregistered_grains(judged, at.state) & ~fit.cut
        if misregistered.any() and solution.paused:  # they may only have been on their way
            observe = fit.observer(problem.target, "free, to the end")
            stopping = fit.held_stopping(problem.target)  # thousands may pause once more
            near = fit.near_expected(problem, RESIDUAL_WHILE_NEAR)  # rotations that views hardly show would run away
            solution = gauss_newton(near, solution.state, stopping, observe)
            judged, at = with_body_edges_discounted(fit, problem, solution)
            misregistered = misregistered_grains(judged, at.state) & ~fit.cut
    return Approach(fit, start, fields, problem, solution, misregistered, fluid)


def finish(job: Job, near: Approach) -> Attempt:
    """The search for misregistered grains, the refinement and the status of each grain."""
    grains, settings, fit, field_pose = job.grains, job.settings, near.fit, near.field_pose
    result = SearchResult(near.problem, near.solution, np.zeros(len(grains), dtype=bool))
    if settings.search:
        result = search(fit, field_pose, near.problem, near.solution, near.misregistered)
    if near.fluid is not None and result.solution is not near.solution:
        result = SearchResult(*near.fluid.settle(result.problem, result.solution), result.ambiguous)
    problem, solution, fixed = fixed_unless_moved(fit, result.problem, result.solution)
    problem, solution, new = refitted_beside(fit, problem, solution, job.new)
    problem, solution = with_body_edges_discounted(fit, problem, solution)
    problem, solution = with_ellipsoids_discounted(fit, problem, solution, new)
    problem, solution = with_hardening(fit, problem, solution)
    if settings.strain:
        problem, solution = solve_strained(fit, problem, solution)
        if near.fluid is not None:
            problem, solution = near.fluid.settle(problem, solution)
    fit.report("classifying the grains", max(fit.expected_stages, fit.stages_done))
    limits = (settings.max_sd_voxel * grains.voxel_size, float(np.deg2rad(settings.max_sd_deg)))
    alignment, solution = align_views(fit, problem, solution)
    refined, ambiguous = refine(fit, field_pose, alignment, solution), dict[int, str]()
    if settings.alternatives:
        detail("other poses that fit")
        refined, moved, ambiguous = settle_ambiguities(fit, field_pose, refined, grains, limits)
        if moved.any():
            refined = refine(fit, field_pose, alignment, refined.solution, refined, moved)
    detail("statuses")
    motions = classify(grains, refined, result.ambiguous, limits, tuple(fit.costs))
    motions = with_reasons(motions, ambiguous)
    motions = with_unlike_neighbours(motions, refined.problem, refined.solution.state, refined.evaluation)
    fit.report("classifying the grains", np.inf)
    if new:
        motions = replace(motions, fit=replace(motions.fit, appeared=new_grains(new)))
    if near.fluid is not None and refined.fluid_covariance is not None:
        found = near.fluid.result(refined.evaluation.fluid_step, refined.fluid_covariance)
        motions = replace(motions, fit=replace(motions.fit, fluid=found))
    supports = grain_supports(refined.problem, refined.solution.state)
    if fixed:
        notes = (*motions.fit.notes, fixed_note(grains.scene.bodies, fixed))
        motions = replace(motions, fit=replace(motions.fit, notes=notes))
    residual = None
    if np.isfinite(motions.translations).all() and not new:
        residual = refined.evaluation.raw_residual
        valid = fit.target.scan.valid
        residual = residual if valid is None else np.where(valid, residual, np.nan)
    return Attempt(motions, np.array([support.share for support in supports]), residual, new)


def unsolved(grains: GrainSet, error: np.linalg.LinAlgError) -> Attempt:
    """Unknown motions of all grains, and the reason."""
    reason = f"the equations of this state could not be solved ({error}); please report it, with these radiographs"
    nothing = np.full((len(grains), 3), np.nan)
    still = Motions.identity(grains.labels, grains.centers)
    motions = replace(still, translations=nothing, rotations=nothing.copy(), reasons=(reason,) * len(grains))
    return Attempt(motions, np.ones(len(grains)))
