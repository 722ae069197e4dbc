"""D-DPC: the motion of every grain from a few radiographs (Khalili et al. 2017), in stages.

From the given start: (1) all grains as one body, from the start itself and from the shift between the centroids of
measured and simulated radiographs; (2) a smooth displacement field; (3) all grains free, under Gaussian filters of
falling width; (4) annealing of the grains that still fit badly, then all grains free again; (5) the refinement: view
alignment, weights, covariances; (6) other poses of grains that look alike in several; (7) trials without grains that
seem to be missing, and with a ball in place of a grain that seems to be new.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from grainmotion._arguments import checked_arguments, renamed_arguments
from grainmotion._typing import Image, Progress
from grainmotion.backends.base import PatchBackend
from grainmotion.backends.device import Device
from grainmotion.diagnosis.grain_scale import scale_notes
from grainmotion.diagnosis.results import common_cause, with_common_cause
from grainmotion.diagnosis.state_geometry import check_state
from grainmotion.errors import InputError
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions, Status
from grainmotion.model.scan import Scan
from grainmotion.preprocessing.flat_field import refuse_counts
from grainmotion.tracking.attempt import Job, approach, finish, unsolved
from grainmotion.tracking.best_start import Start, best_start, with_start_residuals
from grainmotion.tracking.crowds import best_trial_of_crowd, is_crowd
from grainmotion.tracking.settings import PAPER, TrackSettings
from grainmotion.tracking.trials import Trial, best_trial

__all__ = ["PAPER", "TrackSettings", "track", "track_with_residual"]


MIN_FAILED_SHARE = 0.8
"""Share of grains that failed from which a common cause is looked for."""
FAILED = tuple(status.value for status in (Status.NOT_CONVERGED, Status.LEFT_FIELD, Status.NOT_FITTED))


@renamed_arguments(start="initial")
@checked_arguments
def track(
    grains: GrainSet,
    scan: Scan,
    initial: Motions | Sequence[Motions | None] | None = None,
    settings: TrackSettings | None = None,
    *,
    progress: Progress | None = None,
    device: Device | PatchBackend | None = None,
) -> Motions:
    """Measure the rigid motion of every grain from the reference state to the state of ``scan``.

    The method is D-DPC (Khalili et al., Experimental Mechanics 57(6), 2017), with a smooth projector, exact
    derivatives and stages; see `grainmotion.PAPER` for the variant of the paper.

    Parameters
    ----------
    grains : GrainSet
        The grains of the reference state.
    scan : Scan
        A few radiographs of the later state ``(views, rows, columns)``, as line integrals.  They are linearised as the
        reference scan was, see `Scene.hardening`.
    initial : Motions, or a sequence of them, optional
        Motions to start from, as of the state before; none is no motion.  Grains in it without a
        finite motion start as the others moved on average.  Of several, as the state before and `extrapolate`, the one
        that fits the radiographs best is taken; ``Motions.fit.start_residuals`` tells how well each did.
    settings : TrackSettings, optional
        Stages, filters, projector.
    progress : callable, optional
        Called as ``progress(message, done, total)``.
    device : Device or PatchBackend, optional
        Where grains are projected, instead of ``settings.device``: also the workers of a cluster.

    Returns
    -------
    Motions
        One row a grain.  A grain without a reliable motion is no exception: ``statuses`` and ``reasons`` say what
        became of each.

    Raises
    ------
    InputError
        If a start has no row for a grain, or an empty sequence of starts is given.

    Examples
    --------
    >>> motions = gm.track(grains, state)
    >>> motions.statuses.tolist()
    ['converged', 'converged', 'converged', 'converged']
    >>> bool(np.abs(motions.translations - truth.translations).max() < 0.02)  # mm
    True
    """
    refuse_counts(scan.line_integrals)
    return track_with_residual(grains, scan, initial, settings, progress=progress, device=device)[0]


def track_with_residual(
    grains: GrainSet,
    scan: Scan,
    start: Start = None,
    settings: TrackSettings | None = None,
    *,
    progress: Progress | None = None,
    device: Device | PatchBackend | None = None,
) -> tuple[Motions, Image | None]:
    """As `track`, and the residual radiographs of the motions as `analysis.residual_images` would simulate them.

    They are None if the last fit simulated a grain whose motion is not reported, or a stand-in for a new one.
    """
    scan = grains.scene.hardening.apply(scan)
    with threadpool_limits(limits=1, user_api="blas"):  # its matrices are small, and kernels use all cores
        job, start_residuals = _started(Job(grains, scan, None, settings or TrackSettings(), progress, device), start)
        try:
            near = approach(job)
            if is_crowd(near):
                found = best_trial_of_crowd(job, near)
            else:
                found = best_trial(job, near, None if near.misregistered.any() else finish(job, near))
        except np.linalg.LinAlgError as error:  # ends one attempt, not the run
            failed = unsolved(job.grains, error)
            found = Trial(job, failed, failed.motions)
        motions = with_start_residuals(_with_likely_cause(found.job, found.motions), start_residuals)
        return motions, found.attempt.residual


def _started(job: Job, start: Start) -> tuple[Job, tuple[float, ...]]:
    """The job from its start, the best of several; and the relative residual of each of several."""
    if start is None or isinstance(start, Motions):
        return replace(job, start=start), ()
    if not start:
        raise InputError("initial", "an empty sequence", "give motions, several motions, or none")
    if len(start) == 1:
        return replace(job, start=start[0]), ()
    best, residuals = best_start(job.grains, job.scan, start, job.settings, job.device)
    return replace(job, start=start[best]), residuals


def _with_likely_cause(job: Job, motions: Motions) -> Motions:
    """The motions with what the state as a whole shows: wrong sizes as a note, and, where nearly all grains failed, the
    one cause as a note and as the reason of each.
    """
    if np.isin(motions.statuses, FAILED).mean() < MIN_FAILED_SHARE:
        notes = (*scale_notes(job.grains, motions, job.scan), *motions.fit.notes)
        return replace(motions, fit=replace(motions.fit, notes=notes))
    found = check_state(job.grains, job.scan, job.start)
    notes = tuple(f"{f.fact} ({f.evidence}); {f.remedy}" for f in found)
    motions = replace(motions, fit=replace(motions.fit, notes=(*notes, *motions.fit.notes)))
    return with_common_cause(motions, common_cause(motions, known=found))
