"""When the stages of a fit end: those that only bring grains near, the last ones, those that go on after a pause."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from grainmotion.solvers.stopping import Stopping

INITIAL_STOPPING = Stopping(iterations=20, step=0.1, decrease=0.05)
"""For the stages that only bring all grains near."""
COARSE_STOPPING = Stopping(iterations=8, step=0.02, decrease=0.1, straggler_distance=1.0)
"""For stages that a narrower filter follows."""
DECREASE_PER_UNKNOWN, DEFAULT_TOLERANCE = 3e-3, 2e-3
"""Decrease of the cost, over one unknown's share of it, that ends the last stage at the default tolerance (voxels); it
goes with the square of the tolerance."""
PAUSE_DECREASE, PAUSE_RESIDUAL = 0.01, 0.05
"""Share of the cost over several steps below which the last stage may pause, and the relative residual that it needs:
0.004 to 0.016 where all grains fit, 0.1 where some are lost."""
PAUSE_TRIALS_OF_MANY, STEPS_BEFORE_PAUSE_OF_MANY = 3, 3
"""Steps over which a stage of many grains compares its costs to pause, and steps before that.  Of 800 smooth ellipsoids
in 4 views, motions are off the truth by 0.0871 voxel and 6.1 degrees (median) there, and by 0.0859 voxel and 6.0
degrees after 35 more (decision 0056)."""
FIRST_PAUSE_TRIALS = 2
"""The same for the first steps of the last stage, which others on finer voxels follow: each may gain as much of it."""
STEPS_AGAIN, FIRST_LENGTH_AGAIN = 2, 0.5
"""Steps of a stage that paused before, unless they lower the cost by much; part of the first one that is taken, as
steps were shortened to 0.3 to 0.5 by then."""
REST_VOXELS, MAX_FEW_SHARE, MAX_ROUNDS_OF_FEW = 0.025, 0.1, 3
"""Where no more than this share of many grains moves further than these voxels in a step of the last stage, while some
keep it from ending, those are solved for alone, the others fixed; so many times."""
MAX_COARSE_STRAGGLERS = 0.01
"""Share of many grains that may still move by a voxel when a stage that a narrower filter follows ends; there such a
stage ends with the first step that does not lower the cost, too."""
MAX_REJECTIONS = 2
"""Steps of many grains, one after the other, that do not lower the cost, after which the last stage ends."""
STRAGGLER_VOXELS, MAX_STRAGGLER_SHARE = 0.1, 1e-3
"""No decrease ends the last stage while more than this share of the grains moves further than these voxels; those
that still do are reported as moving."""


def of_coarse_stage(iterations: int, tolerance: float, many: bool) -> Stopping:
    """Of a stage that a narrower filter follows, with the ``tolerance`` in voxels."""
    iterations = min(COARSE_STOPPING.iterations, iterations)
    stopping = replace(COARSE_STOPPING, iterations=iterations, step=max(tolerance, COARSE_STOPPING.step))
    if not many:
        return stopping
    return replace(stopping, stragglers=MAX_COARSE_STRAGGLERS, rejections=1, interpolate=True)


def of_last_stage(iterations: int, tolerance: float, unknowns_per_pixel: float, many: bool) -> Stopping:
    """Of a last stage: no grain moves further than the tolerance (voxels), or all by little of their sd.

    ½‖r‖² over the number of pixels is the decrease by one unknown that moves by its standard deviation.
    """
    decrease = DECREASE_PER_UNKNOWN * min(unknowns_per_pixel, 1.0) * (tolerance / DEFAULT_TOLERANCE) ** 2
    return Stopping(iterations, tolerance, decrease, STRAGGLER_VOXELS, MAX_STRAGGLER_SHARE, interpolate=many)


def pausing(stopping: Stopping, measured_square: float, many: bool) -> Stopping:
    """Of a last stage that may end where it only creeps (decisions 0045 and 0056); ``measured_square`` is ‖F w b‖²."""
    stopping = replace(stopping, pause=PAUSE_DECREASE, pause_cost=0.5 * PAUSE_RESIDUAL**2 * measured_square)
    if not many:
        return stopping
    return replace(stopping, pause_trials=PAUSE_TRIALS_OF_MANY, pause_after=STEPS_BEFORE_PAUSE_OF_MANY, creeping=True)


def in_parts(stopping: Stopping) -> Stopping:
    """Of a last stage of many grains, which also ends where only few of them still move."""
    return replace(stopping, rest=REST_VOXELS, few=MAX_FEW_SHARE, rejections=MAX_REJECTIONS)


def of_few(stopping: Stopping, share: float) -> Stopping:
    """Those of a stage of all grains for this share of them: costs are still those of all."""
    decrease, stragglers = stopping.decrease * share, min(stopping.stragglers / share, 1.0)
    return replace(stopping, decrease=decrease, stragglers=stragglers, few=0.0, pause=0.0, rejections=np.inf)


def of_first_steps(stopping: Stopping) -> Stopping:
    """Those of a last stage that may pause, for its first steps on the reference's voxels."""
    return replace(
        stopping, step=max(stopping.step, COARSE_STOPPING.step), decrease=10 * stopping.decrease,
        stragglers=MAX_COARSE_STRAGGLERS, rejections=1, pause=FIRST_PAUSE_TRIALS * stopping.pause,
        pause_trials=FIRST_PAUSE_TRIALS, pause_after=FIRST_PAUSE_TRIALS,
    )  # fmt: skip


def again(stopping: Stopping) -> Stopping:
    """Those of a stage that paused before, after some grains moved to another pose that is near its place."""
    each = stopping.pause / stopping.pause_trials
    return replace(
        stopping, pause=each, pause_trials=1, pause_after=STEPS_AGAIN, creeping=False, first_length=FIRST_LENGTH_AGAIN
    )
