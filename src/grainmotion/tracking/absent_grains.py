"""The motions of the grains that are on the radiographs, and which are not there.

Where grains fit badly before any search, `presence` asks which are there at all.  The others are left out and the rest
is fitted as if they had never been there.  Then both are asked again: a grain that was left out comes back if what
the rest leaves over holds its shadow where its neighbours went, or something of a grain's size within its reach.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions, Status
from grainmotion.model.pose import Pose
from grainmotion.objective.residual import StateProblem
from grainmotion.rotations import rotation_vector
from grainmotion.tracking.attempt import Approach, Attempt, Job, approach, finish
from grainmotion.tracking.global_search import affine_field_through
from grainmotion.tracking.missing_grains import complete, registered
from grainmotion.tracking.presence import Census, count_again, none_is_there, take_census
from grainmotion.tracking.unexplained import unexplained_places

MAX_CENSUS_ROUNDS = 4
"""Times that grains are left out or come back, at most."""
MIN_REGISTERED_SHARE = 0.5
"""Share of the grains left in that must be found for the others to be called absent: if most fail, the radiographs
themselves are wrong."""
MIN_DISTURBED_SHARE, MAX_DISTURBED_GRAINS = 0.3, 60
"""Share of badly fitting grains from which one absent grain may disturb all, in a sample of so many grains at most."""
WEAK_AMPLITUDE, MAX_WEAK_TRIALS, MAX_LEFT_SHARE = 0.8, 3, 0.5
"""Amplitude up to which a grain is left out in trial, how many are, and what share of the badly fitting grains may be
left then.  With 2 views and one of 21 grains gone it has 0.55 to 0.62, the others 0.71 at least."""
REACH_DIAMETERS = 3.0
"""Grain diameters from where its neighbours went within which something unexplained may be a grain left out."""
NONE_REASON = (
    "the radiographs hold less than the shadow of any grain: none is there; check whether the sample was in the beam"
)
ELSEWHERE_REASON = (
    "its shadow is not where its neighbours went, but the radiographs hold something near {place} that no grain "
    "explains: it may be there, far from its place or in pieces; give a start near it, or check it"
)


@dataclass(frozen=True, eq=False)
class _Rest:
    """The grains of ``rows`` alone: their job and where they are after its first stages."""

    rows: NDArray[np.int64]
    job: Job
    near: Approach


def without_absent(job: Job, near: Approach) -> Attempt | None:
    """The motions without absent grains; None if all are there, or if the rest does not fit either."""
    if near.misregistered.any():
        with suppress(np.linalg.LinAlgError):  # ends this attempt, not the run
            return _of_those_present(job, near)
    return None


def _of_those_present(job: Job, near: Approach) -> Attempt | None:
    """The same where grains fit badly."""
    if none_is_there(near.fit, near.start):
        return _all_absent(job.grains)
    rest = _those_present(job, near)
    if rest is None:
        return None
    result = finish(rest.job, rest.near)
    if registered(result.motions).mean() < MIN_REGISTERED_SHARE:
        return None
    motions = complete(result.motions, job.grains)
    for _ in range(MAX_CENSUS_ROUNDS):
        back, places = _come_back(job, near, rest, motions)
        if not len(back):
            break
        start = _started(job.grains, motions, places)
        rows = np.union1d(rest.rows, back)
        more = _of_rows(job, rows, start, fields=False)
        found = finish(more.job, more.near)
        if registered(found.motions).sum() <= registered(result.motions).sum():
            return _completed(job, result, motions, places)
        rest, result, motions = more, found, complete(found.motions, job.grains)
    return _completed(job, result, motions, {})


def _all_absent(grains: GrainSet) -> Attempt:
    """No grain is there."""
    motions = Motions.identity(grains.labels, grains.centers)
    unknown, n = np.full((len(grains), 3), np.nan), len(grains)
    motions = replace(
        motions,
        translations=unknown,
        rotations=unknown.copy(),
        statuses=np.full(n, Status.ABSENT.value, dtype=motions.statuses.dtype),
        reasons=(NONE_REASON,) * n,
    )
    return Attempt(motions, np.zeros(n))


def _those_present(job: Job, near: Approach) -> _Rest | None:
    """The grains that are there; None if all or none are."""
    rest = _Rest(np.arange(len(job.grains)), job, near)
    for _ in range(MAX_CENSUS_ROUNDS):
        if not rest.near.misregistered.any():
            break
        census = _census(rest.near)
        present = census.present
        if not present.any():
            break
        fewer = _without_a_weak_one(job, rest, census) if present.all() else _rest(job, rest, census, present)
        if fewer is None:
            break
        rest = fewer
    return None if len(rest.rows) == len(job.grains) else rest


def _census(near: Approach) -> Census:
    """Which grains are there, in the liquid that was found with all of them or in that of the reference.

    Shadows that are not there can give the liquid any level and attenuation.
    """
    census = take_census(near.fit, near.start, near.fields)
    if near.fluid is None:
        return census
    unchanged = take_census(near.fluid.fit_with(near.start), near.start, near.fields)
    return min(census, unchanged, key=lambda census: census.residual)


def _rest(job: Job, rest: _Rest, census: Census, present: NDArray[np.bool_]) -> _Rest:
    """Some of the grains after the first stages from the pose of a census."""
    start = _motions_at(rest.job.grains, census.pose)
    return _of_rows(job, rest.rows[present], start, job.settings.fields)


def _without_a_weak_one(job: Job, rest: _Rest, census: Census) -> _Rest | None:
    """The rest without one more grain, if far fewer fit badly then.

    With two views one absent grain can take half an amplitude from its neighbours, and disturb all.
    """
    before = rest.near.misregistered
    if before.mean() < MIN_DISTURBED_SHARE or not 1 < len(before) <= MAX_DISTURBED_GRAINS:
        return None
    for k in np.argsort(census.amplitudes)[:MAX_WEAK_TRIALS]:
        if census.amplitudes[k] < WEAK_AMPLITUDE * census.gain:
            fewer = _rest(job, rest, census, np.arange(len(before)) != k)
            if fewer.near.misregistered.sum() < MAX_LEFT_SHARE * before.sum():
                return fewer
    return None


def _of_rows(job: Job, rows: NDArray[np.int64], start: Motions, fields: bool) -> _Rest:
    """Some of the grains after the first stages from a start."""
    others = np.setdiff1d(np.arange(len(job.grains)), rows).tolist()
    some = replace(job, grains=job.grains.without(others), start=start, settings=replace(job.settings, fields=fields))
    return _Rest(rows, some, approach(some))


def _come_back(job: Job, near: Approach, rest: _Rest, motions: Motions) -> tuple[NDArray[np.int64], dict[int, Float]]:
    """Rows of the grains left out that may be there after all, and the places (mm, x y z) where some of them may be."""
    out = np.setdiff1d(np.arange(len(job.grains)), rest.rows)
    pose = _expected(near, rest.rows, motions)
    width = job.settings.filters[min(1, len(job.settings.filters) - 1)]
    fit = near.fit
    if near.fluid is not None and rest.near.fluid is not None:
        fit = near.fluid.fit_with(pose, rest.near.fluid.values)
    census = count_again(fit, pose, width)
    back = {int(k): near.fit.grains.centers[k] + pose.translations[k] for k in out if census.present[k]}
    problem = StateProblem(rest.near.fit.grains, rest.near.fit.filtered_target(job.settings.filters[-1]))
    seen = Pose(pose.translations[rest.rows], pose.matrices[rest.rows])
    reach = REACH_DIAMETERS * 2 * float(np.median(near.fit.grains.radii))
    for *place, _ in unexplained_places(problem, seen, problem.evaluate(seen)):
        free = [k for k in out if int(k) not in back]
        distances = [np.linalg.norm(near.fit.grains.centers[k] + pose.translations[k] - place) for k in free]
        if distances and min(distances) < reach:
            back[int(free[int(np.argmin(distances))])] = np.array(place)
    return np.array(sorted(back), dtype=np.int64), back


def _expected(near: Approach, rows: NDArray[np.int64], motions: Motions) -> Pose:
    """Where the grains of ``rows`` are, and where their field carries the others."""
    grains, known = near.fit.grains, np.asarray(np.isfinite(motions.translations).all(axis=1))
    if not known.any():
        return near.field_pose
    found = Pose(motions.translations[known], motions.matrices[known])
    places = np.column_stack([np.ones(len(grains)), grains.centers])
    mean = found.translations.mean(axis=0)
    translations = np.where(known[:, None], motions.translations, mean)
    if known.sum() >= 8:
        some = grains.select(np.flatnonzero(known))
        field = affine_field_through(found, some, found)
        coefficients = np.linalg.lstsq(places[known], field.translations, rcond=1e-9)[0]
        translations = np.where(known[:, None], motions.translations, places @ coefficients)
    matrices = np.where(known[:, None, None], np.nan_to_num(motions.matrices), np.eye(3))
    return Pose(translations, matrices)


def _started(grains: GrainSet, motions: Motions, places: dict[int, Float]) -> Motions:
    """The motions as a start, with grains that come back at their places."""
    start = replace(motions, translations=motions.translations.copy(), rotations=motions.rotations.copy())
    for row, place in places.items():
        start.translations[row] = place - grains.centers[row]
        start.rotations[row] = 0.0
    return start


def _motions_at(grains: GrainSet, pose: Pose) -> Motions:
    """A pose as the start of a fit."""
    still = Motions.identity(grains.labels, grains.centers)
    return replace(still, translations=pose.translations, rotations=rotation_vector(pose.matrices))


def _completed(job: Job, result: Attempt, motions: Motions, places: dict[int, Float]) -> Attempt:
    """The attempt for all grains; those whose shadow may be at ``places`` are not called absent."""
    statuses, reasons = motions.statuses.copy(), list(motions.reasons)
    for row, (x, y, z) in places.items():
        statuses[row] = Status.NOT_CONVERGED.value
        reasons[row] = ELSEWHERE_REASON.format(place=f"x = {x:.3g}, y = {y:.3g}, z = {z:.3g}")
    supports = np.zeros(len(job.grains))
    supports[np.isin(job.grains.labels, result.motions.labels)] = result.supports
    return Attempt(replace(motions, statuses=statuses, reasons=tuple(reasons)), supports, result.residual, result.new)
