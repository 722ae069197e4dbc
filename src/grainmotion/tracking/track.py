"""D-DPC: the motion of every grain from a few radiographs (Khalili et al. 2017), in stages.

From the given start: (1) all grains as one body, from the start and from the shift that the
radiographs' centroids tell; (2) a smooth displacement field; (3) all grains free, under Gaussian
filters of falling width; (4) grains that still fit badly are searched for by annealing, then all are
free again; (5) the last solutions: poses of views, weights, covariances; (6) grains whose shadow is not
there are left out, and a ball stands in for one that appeared.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from grainmotion._typing import Float, Progress
from grainmotion.backends.device import Device, chosen
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.scan import Scan
from grainmotion.objective.data_term import Target
from grainmotion.objective.nuisance_motions import NuisanceModel
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.projection.volumes import project
from grainmotion.segmentation.extraction import packed_body
from grainmotion.tracking.background_motion import HELD, held_if_still
from grainmotion.tracking.classification import judge
from grainmotion.tracking.global_search import Found, search
from grainmotion.tracking.initial_guess import approach, starting_pose
from grainmotion.tracking.missing_grains import ALL_TRIED, FEW, complete, improves, merit, shadows_held, suspects
from grainmotion.tracking.multistage import MultistageFit
from grainmotion.tracking.new_grains import may_have_appeared, place_of_surplus, started, with_stand_in, without_last
from grainmotion.tracking.refinement import polish
from grainmotion.tracking.settings import PAPER, TrackSettings

__all__ = ["PAPER", "TrackSettings", "track"]


BODY_SHIFT, BODY_TURN = 20.0, 0.1
"""Voxels, radians: standard deviations of the prior on a moving background."""


def track(
    grains: GrainSet,
    scan: Scan,
    start: Motions | None = None,
    settings: TrackSettings | None = None,
    *,
    progress: Progress | None = None,
    device: Device | None = None,
) -> Motions:
    """Measure the rigid motion of every grain from the reference state to the state of ``scan``.

    Parameters
    ----------
    grains : GrainSet
        The grains of the reference state.
    scan : Scan
        A few radiographs of the later state, as line integrals.
    start : Motions, optional
        Motions to start from, as of the state before; none is no motion.  Grains in it without a
        finite motion start as the others moved on average.
    settings : TrackSettings, optional
        Stages, filters, projector.
    progress : callable, optional
        Called as ``progress(message, done, total)``.
    device : Device, optional
        Where rays are walked, instead of ``settings.device``: the workers of a cluster.

    Returns
    -------
    Motions
        One row a grain; what became of it is in ``statuses`` and ``reasons``, never an exception.
    """
    settings = settings or TrackSettings()
    with threadpool_limits(limits=1, user_api="blas"):  # its matrices are small, and kernels use all cores
        return _track(grains, scan, start, settings, progress, device)


def _unsolved(grains: GrainSet, error: np.linalg.LinAlgError) -> Motions:
    """No motion of any grain, and why: equations that a library refuses end one attempt, not the run."""
    reason = f"the equations of this state could not be solved ({error}); please report it, with these radiographs"
    nothing = np.full((len(grains), 3), np.nan)
    still = Motions.identity(grains.labels, grains.centers)
    return replace(still, translations=nothing, rotations=nothing.copy(), reasons=(reason,) * len(grains))


def _track(
    grains: GrainSet,
    scan: Scan,
    start: Motions | None,
    settings: TrackSettings,
    progress: Progress | None,
    device: Device | None,
) -> Motions:
    """All grains; then without those that seem not to be there, if the others fit better so."""
    whole, supports = _all_together(grains, scan, start, settings, progress, device)
    best, present = whole, grains
    while settings.search and (absent := suspects(best, supports)):
        trials = [present.without(rows) for rows in absent]
        begin, how = start, settings
        if len(present) > ALL_TRIED:  # the rest of a large sample is near its place
            begin, how = best, replace(settings, fields=False, filters=settings.filters[1:] or settings.filters)
        elif len(trials) > FEW:  # the right one needs no search
            how = replace(settings, search=False)
        ends = [_all_together(t, scan, begin, how, progress, device) for t in trials]
        k = max(range(len(ends)), key=lambda k: merit(ends[k][0]))
        if not improves(ends[k][0], best):
            break
        present, (best, supports) = trials[k], ends[k]
    found = complete(best, grains) if best.ok.sum() > whole.ok.sum() else whole
    if settings.search and may_have_appeared(found):
        more = _with_another(grains, scan, start, settings, progress, device)
        found = more if more is not None and more.ok.sum() > found.ok.sum() else found
    return found


def _with_another(
    grains: GrainSet,
    scan: Scan,
    start: Motions | None,
    settings: TrackSettings,
    progress: Progress | None,
    device: Device | None,
) -> Motions | None:
    """The grains beside one that stands in for another that appeared; None if there is no place for one."""
    try:
        place = place_of_surplus(_course(grains, scan, settings, progress, device), starting_pose(grains, start))
    except np.linalg.LinAlgError:
        place = None
    if place is None:
        return None
    whole = with_stand_in(grains, place)
    quick = replace(settings, search=False)
    return without_last(_all_together(whole, scan, started(start, whole), quick, progress, device)[0])


def _all_together(
    grains: GrainSet,
    scan: Scan,
    start: Motions | None,
    settings: TrackSettings,
    progress: Progress | None,
    device: Device | None,
) -> tuple[Motions, Float]:
    """All stages for some grains, and how much of each grain's shadow the radiographs hold."""
    try:
        course = _course(grains, scan, settings, progress, device)
        base, pose = approach(course, starting_pose(grains, start))
        done = 1 if settings.fields and len(settings.filters) > 1 else 0  # the approach ends with the first filter
        problem, solution = course.free(pose, "free", settings.filters[done:])
        found = Found(problem, solution, np.zeros(len(grains), dtype=bool))
        if settings.search:
            found = search(course, base, problem, solution)
        problem, solution, held_back = held_if_still(course, found.problem, found.solution)
        course.tell("judging the grains", course.stages)
        polished = polish(course, base, problem, solution)
        limits = (settings.max_sd_voxel * grains.voxel_size, float(np.deg2rad(settings.max_sd_deg)))
        motions = judge(grains, polished, found.doubtful, limits, tuple(course.costs))
        if held_back:
            motions = replace(
                motions, fit=replace(motions.fit, background=np.zeros(6), notes=(*motions.fit.notes, HELD))
            )
        held = shadows_held(polished.problem, polished.solution.state)
        return motions, np.array([shadow.support for shadow in held])
    except np.linalg.LinAlgError as error:
        return _unsolved(grains, error), np.ones(len(grains))


def _course(
    grains: GrainSet, scan: Scan, settings: TrackSettings, progress: Progress | None, device: Device | None = None
) -> MultistageFit:
    device, smooth = device or chosen(settings.device), settings.projector == "trilinear"
    packed, fine = (GrainArrays.of(grains, fine=f and smooth).on(device) for f in (False, True))
    return MultistageFit(settings, packed, fine, _target(grains, scan, settings, device), progress)


def _target(grains: GrainSet, scan: Scan, settings: TrackSettings, device: Device) -> Target:
    """What is fitted, and the background that stays or moves."""
    fixed, body, loose = np.zeros(scan.line_integrals.shape, grains.precision), None, NuisanceModel()
    if grains.background is not None:
        fixed = project(grains.background, scan.geometry, projector=settings.projector)
        body = packed_body(grains.background).on(device)
        h = grains.voxel_size
        loose = NuisanceModel(body=grains.background_moves, body_shift=BODY_SHIFT * h, body_turn=BODY_TURN)
    return Target(
        scan, fixed, settings.projector, 0.0, derivatives=settings.derivatives, body=body, loose=loose, device=device
    )
