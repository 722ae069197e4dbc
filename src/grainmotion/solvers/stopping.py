"""When Gauss–Newton iterations end or pause."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

DEFAULT_FORCING = 1e-4
"""Relative residual to which conjugate gradients solve a step."""

PAUSE_TRIALS = 5
"""Steps tried, accepted or not, whose decrease tells whether to pause."""

MIN_STEPS_BEFORE_PAUSE = 10
"""Accepted steps before an iteration may pause; where all unknowns are determined, 4 to 8 are enough."""

CREEPING_SHARE = 0.25
"""Share of the mean decrease of the last steps tried, from which the last of them shows that they do not shrink."""


@dataclass(frozen=True)
class Stopping:
    """When to stop.

    Attributes
    ----------
    iterations : int
        Accepted steps at most.
    step : float
        Displacement of every moving object below which the iteration ends.
    decrease : float
        Relative decrease of the cost below which it ends.  A predicted decrease counts as well: such a last step is
        taken without a linearisation at its end.
    straggler_distance, stragglers : float
        No decrease ends the iteration while more than a share ``stragglers`` of the objects moves further than
        ``straggler_distance``.
    forcing : float
        Relative residual to which steps of large problems are solved; they end before where iterations lower the cost
        by little of what ``decrease`` asks for.
    rejections : float
        Steps that do not lower the cost, one after the other, after which it ends once some have.
    rest, few : float
        It also ends where more than the share ``stragglers`` moves further than ``straggler_distance``, which keeps it
        from ending otherwise, but no more than the share ``few`` moves further than ``rest``: those few can be solved
        for alone (`Solution.moving`).
    interpolate : bool
        Steps are shortened to where the parabola through the last two costs has its least: where residuals are noise
        and images of voxels have ripples, the cost can bend twice as much as JᵀJ tells, and full steps go to and fro.
    first_length : float
        The part of the first step that is taken; less than 1 where it is known from before to bend so.
    pause, pause_cost : float
        Relative decrease over ``pause_trials`` steps tried below which it pauses, after ``pause_after`` accepted ones
        and at a cost below ``pause_cost``: what hardly matters may be fixed before it goes on.
    pause_trials, pause_after : int
        See there.
    creeping : bool
        It pauses only where the last of these steps shows that they do not shrink (`CREEPING_SHARE`).
    """

    iterations: int = 30
    step: float = 1e-3
    decrease: float = 1e-7
    straggler_distance: float = np.inf
    stragglers: float = 0.0
    forcing: float = DEFAULT_FORCING
    rejections: float = np.inf
    rest: float = 0.0
    few: float = 0.0
    interpolate: bool = False
    first_length: float = 1.0
    pause: float = 0.0
    pause_cost: float = np.inf
    pause_trials: int = PAUSE_TRIALS
    pause_after: int = MIN_STEPS_BEFORE_PAUSE
    creeping: bool = False


def little_gained(tried: list[float], stopping: Stopping) -> bool:
    """Whether the least costs after each step ``tried`` say that the iteration should pause."""
    decreases = -np.diff(tried[-1 - stopping.pause_trials :])
    shrinking = stopping.creeping and 0 < decreases[-1] < CREEPING_SHARE * decreases.mean()
    return bool(decreases.sum() < stopping.pause * tried[-1]) and not shrinking
