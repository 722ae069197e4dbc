"""New grains: how many grains a state holds that the reference does not, roughly where, and how large.

Unexplained attenuation draws all grains towards it.  So where grains fit badly before any search, the census of
`presence` is asked what the radiographs hold beside the grains that are there: at the place where all views leave most,
an ellipsoid is fitted, and the next place is sought beside it, until nothing of a grain's size is left.  Census and
ellipsoids are found again beside each other, since each disturbs the other.  Their line integrals then are fixed images
beside the grains, as those of bodies that do not move, and are fitted again once all grains are in their places.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from grainmotion.model.motions import Motions
from grainmotion.model.pose import Pose
from grainmotion.projection.grain_arrays import planar
from grainmotion.rotations import rotation_vector
from grainmotion.tracking.attempt import Approach, Attempt, Job, approach, finish
from grainmotion.tracking.ellipsoids import Ellipsoid
from grainmotion.tracking.ellipsoids_beside import with_ellipsoids
from grainmotion.tracking.leftover import beside_census, beside_pose
from grainmotion.tracking.missing_grains import registered
from grainmotion.tracking.presence import Census, census_of_fields, count_again

STIFF, LOOSE = 0.1, 0.3
"""Spreads of radius and attenuation that are expected, while grains are near and once each is in its place."""
FIELD_ROUNDS, FREE_ROUNDS = 3, 2
"""Rounds of ellipsoids and a census of fields, and of ellipsoids beside free grains."""
MAX_RESIDUAL_BESIDE = 0.75
"""Residual of the census beside ellipsoids, over the one without, up to which grains have appeared."""


@dataclass(frozen=True, eq=False)
class _Beside:
    """Ellipsoids, and the census of the grains beside them."""

    found: tuple[Ellipsoid, ...]
    census: Census


def find_new_grains(job: Job, near: Approach) -> tuple[Ellipsoid, ...]:
    """Grains of the state that the reference does not have, where grains fit badly; none if they explain nothing."""
    fit = near.fit
    if not near.misregistered.any() or len(job.scan) < 2 or planar(fit.grains, job.scan.geometry):
        return ()
    alone = census_of_fields(fit, near.start, near.fields)
    best = _Beside((), alone)
    for pose in [near.start, *near.fields[:1]]:
        census = count_again(fit, pose, job.settings.field_filter)
        for _ in range(FIELD_ROUNDS):
            found = beside_census(fit, census, STIFF)
            if not found:
                break
            # fields start anew, as those beside other ellipsoids were drawn to what these left
            census = census_of_fields(with_ellipsoids(fit, found), pose, [])
            best = min(best, _Beside(found, census), key=lambda trial: trial.census.residual)
    if best.census.residual > MAX_RESIDUAL_BESIDE * alone.residual or not best.census.present.any():
        return ()
    return _beside_free_grains(job, near, best)


def _beside_free_grains(job: Job, near: Approach, beside: _Beside) -> tuple[Ellipsoid, ...]:
    """Ellipsoids once each of the grains that are there has its own motion."""
    rows, found = np.flatnonzero(beside.census.present), beside.found
    absent = np.flatnonzero(~beside.census.present)
    pose = Pose(beside.census.pose.translations[rows], beside.census.pose.matrices[rows])
    quick = replace(job.settings, fields=False, search=False)
    grains = job.grains.without(absent.tolist())
    for _ in range(FREE_ROUNDS):
        start = replace(
            Motions.identity(grains.labels, grains.centers),
            translations=pose.translations,
            rotations=rotation_vector(pose.matrices),
        )
        free = approach(replace(job, grains=grains, new=found, start=start, settings=quick, progress=None))
        pose = free.solution.state
        found = beside_pose(with_ellipsoids(free.fit, found, -1), pose, LOOSE, found)
    return found


def beside_new_grains(job: Job, near: Approach) -> tuple[tuple[Job, Approach], ...]:
    """The job and its first stages beside the new grains, if there seem to be any, and then without them."""
    found: tuple[Ellipsoid, ...] = ()
    if job.settings.search:
        with suppress(np.linalg.LinAlgError):  # ends the search, not the run
            found = find_new_grains(job, near)
    if not found:
        return ((job, near),)
    beside = replace(job, new=found)
    return (beside, approach(beside)), (job, near)


def with_undisturbing(job: Job, first: Attempt) -> Attempt:
    """The attempt beside new grains that disturbed none so far; the same if there is none."""
    motions = first.motions
    if job.new or not any("that is no grain" in note for note in motions.fit.notes):
        return first
    rows = np.flatnonzero(registered(motions))
    if len(job.scan) < 2 or len(rows) < len(motions) or planar(job.fit().grains, job.scan.geometry):
        return first
    pose = Pose(motions.translations, motions.matrices)
    found = beside_pose(job.fit(), pose, LOOSE)
    if not found:
        return first
    settings = replace(job.settings, fields=False, filters=job.settings.filters[-1:])
    again = replace(job, new=found, start=motions, settings=settings)
    second = finish(again, approach(again))
    return second if registered(second.motions).all() else first
