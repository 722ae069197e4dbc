"""What became of the grains that fit badly: trials with new, absent and broken grains, the best of which counts."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from grainmotion.model.motions import Motions, Status
from grainmotion.tracking.absent_grains import without_absent
from grainmotion.tracking.attempt import Approach, Attempt, Job, attempt, finish
from grainmotion.tracking.broken_grains import with_broken
from grainmotion.tracking.missing_grains import (
    MAX_GRAINS_ALL_TRIED,
    MAX_SINGLE_SUSPECTS,
    complete,
    improves,
    merit,
    registered,
    suspects,
)
from grainmotion.tracking.new_grains import beside_new_grains, with_undisturbing

EXPLAINED = (Status.ABSENT.value, Status.BROKEN.value)
"""Statuses that say why a grain has no motion as a whole."""


@dataclass(frozen=True, eq=False)
class Trial:
    """A job, perhaps with new grains, the attempt at it that explains most, and the ``motions`` of all its grains."""

    job: Job
    attempt: Attempt
    motions: Motions


def best_trial(job: Job, near: Approach, known: Attempt | None = None) -> Trial:
    """The trial that explains most of a sample, after the stages before any search.

    ``known`` is the attempt at the job as it is, if it was made already: no grain fitted badly.
    """
    grains, first = job.grains, None
    for trial, start in beside_new_grains(job, near):
        try:
            found = known or without_absent(trial, start) or finish(trial, start)
            found = with_broken(trial, start, found) or found
        except np.linalg.LinAlgError:  # ends one trial, not the run
            if first is None:
                raise
            break
        if first is None or registered(found.motions).sum() > registered(first.motions).sum():
            job, first = trial, found
        if (registered(first.motions) | np.isin(first.motions.statuses, EXPLAINED)).all():
            break
    assert first is not None
    with suppress(np.linalg.LinAlgError):
        first = with_undisturbing(job, first)
    explained = np.isin(first.motions.statuses, EXPLAINED).any()
    best = first if explained else _without_missing(job, first)
    if registered(best.motions).sum() > registered(first.motions).sum():
        return Trial(job, best, complete(best.motions, grains))
    return Trial(job, first, first.motions)


def quick_trial(job: Job, near: Approach) -> Trial | None:
    """The same with new and absent grains only, without any search; None if there are none."""
    for trial, start in beside_new_grains(job, near):
        found = without_absent(trial, start)
        if found is None and trial.new:
            found = finish(trial, replace(start, misregistered=np.zeros_like(start.misregistered)))
        if found is not None:
            return Trial(trial, found, found.motions)
    return None


def _without_missing(job: Job, first: Attempt) -> Attempt:
    """The best attempt without grains that seem to be missing; the first one if none is better."""
    settings, present, best = job.settings, job.grains, first
    while settings.search and (missing := suspects(best.motions, best.supports)):
        start, trial_settings = job.start, settings
        if len(present) > MAX_GRAINS_ALL_TRIED:  # the rest of a large sample is near its place
            start = best.motions
            trial_settings = replace(settings, fields=False, filters=settings.filters[1:] or settings.filters)
        elif len(missing) > MAX_SINGLE_SUSPECTS:  # the right trial needs no search
            trial_settings = replace(settings, search=False)
        trials = [replace(job, grains=present.without(rows), start=start, settings=trial_settings) for rows in missing]
        attempts = [attempt(trial) for trial in trials]
        k = max(range(len(attempts)), key=lambda k: merit(attempts[k].motions))
        if not improves(attempts[k].motions, best.motions):
            break
        present, best = trials[k].grains, attempts[k]
    return best
