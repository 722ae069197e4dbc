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
from grainmotion.tracking.background_motion import FIXED_BACKGROUND_NOTE, fixed_unless_moved
from grainmotion.tracking.classification import classify
from grainmotion.tracking.global_search import SearchResult, search
from grainmotion.tracking.initial_guess import initialise, starting_pose
from grainmotion.tracking.missing_grains import (
    MAX_GRAINS_ALL_TRIED,
    MAX_SINGLE_SUSPECTS,
    complete,
    grain_supports,
    improves,
    merit,
    suspects,
)
from grainmotion.tracking.multistage import MultistageFit
from grainmotion.tracking.new_grains import (
    may_have_appeared,
    place_of_new_grain,
    start_with_stand_in,
    with_stand_in,
    without_last,
)
from grainmotion.tracking.refinement import refine
from grainmotion.tracking.settings import PAPER, TrackSettings

__all__ = ["PAPER", "TrackSettings", "track"]


BACKGROUND_SHIFT_SD, BACKGROUND_ROTATION_SD = 20.0, 0.1
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
        if len(present) > MAX_GRAINS_ALL_TRIED:  # the rest of a large sample is near its place
            begin, how = best, replace(settings, fields=False, filters=settings.filters[1:] or settings.filters)
        elif len(trials) > MAX_SINGLE_SUSPECTS:  # the right one needs no search
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
        place = place_of_new_grain(
            _multistage_fit(grains, scan, settings, progress, device), starting_pose(grains, start)
        )
    except np.linalg.LinAlgError:
        place = None
    if place is None:
        return None
    whole = with_stand_in(grains, place)
    quick = replace(settings, search=False)
    return without_last(_all_together(whole, scan, start_with_stand_in(start, whole), quick, progress, device)[0])


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
        fit = _multistage_fit(grains, scan, settings, progress, device)
        base, pose = initialise(fit, starting_pose(grains, start))
        done = 1 if settings.fields and len(settings.filters) > 1 else 0  # the approach ends with the first filter
        problem, solution = fit.solve_free(pose, "free", settings.filters[done:])
        found = SearchResult(problem, solution, np.zeros(len(grains), dtype=bool))
        if settings.search:
            found = search(fit, base, problem, solution)
        problem, solution, held_back = fixed_unless_moved(fit, found.problem, found.solution)
        fit.report("judging the grains", fit.expected_stages)
        polished = refine(fit, base, problem, solution)
        limits = (settings.max_sd_voxel * grains.voxel_size, float(np.deg2rad(settings.max_sd_deg)))
        motions = classify(grains, polished, found.doubtful, limits, tuple(fit.costs))
        if held_back:
            motions = replace(
                motions,
                fit=replace(motions.fit, background=np.zeros(6), notes=(*motions.fit.notes, FIXED_BACKGROUND_NOTE)),
            )
        held = grain_supports(polished.problem, polished.solution.state)
        return motions, np.array([shadow.support for shadow in held])
    except np.linalg.LinAlgError as error:
        return _unsolved(grains, error), np.ones(len(grains))


def _multistage_fit(
    grains: GrainSet, scan: Scan, settings: TrackSettings, progress: Progress | None, device: Device | None = None
) -> MultistageFit:
    device, smooth = device or chosen(settings.device), settings.projector == "trilinear"
    packed, fine = (GrainArrays.of(grains, fine=f and smooth).on(device) for f in (False, True))
    return MultistageFit(settings, packed, fine, _target(grains, scan, settings, device), progress)


def _target(grains: GrainSet, scan: Scan, settings: TrackSettings, device: Device) -> Target:
    """What is fitted, and the background that stays or moves."""
    fixed, body, nuisance = np.zeros(scan.line_integrals.shape, grains.precision), None, NuisanceModel()
    if grains.background is not None:
        fixed = project(grains.background, scan.geometry, projector=settings.projector)
        body = packed_body(grains.background).on(device)
        h = grains.voxel_size
        nuisance = NuisanceModel(
            background=grains.background_moves,
            background_shift_sd=BACKGROUND_SHIFT_SD * h,
            background_rotation_sd=BACKGROUND_ROTATION_SD,
        )
    return Target(
        scan,
        fixed,
        settings.projector,
        0.0,
        derivatives=settings.derivatives,
        background=body,
        nuisance=nuisance,
        device=device,
    )
