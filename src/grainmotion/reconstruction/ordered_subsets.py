"""Ordered subsets: each update of a volume uses some of the views; SART uses one view at a time.

Plain SART takes one view after the other, in golden-ratio order, with a relaxation that falls from sweep to sweep.
Its later sweeps are spent on the disagreement of single views.  Subsets of views average that out, momentum (Nesterov
1983; with ordered subsets: Kim, Ramani and Fessler 2015) compensates for the fewer updates, and a start on coarser
voxels (`coarse_start`) gives the long wavelengths.  Towards the end subsets grow and relaxation falls, which reduces
the remaining disagreement.  Figures: decision 0012.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence

import numpy as np

from grainmotion._typing import Progress
from grainmotion.model.progress import counted
from grainmotion.reconstruction.settings import ReconstructSettings
from grainmotion.reconstruction.system import Iterate, SumOfSquares, Views, golden_order, relative

DEFAULT_SWEEPS, DEFAULT_RELAXATION, DEFAULT_DECAY, DEFAULT_SWEEP_TOLERANCE = 6, 1.0, 0.5, 0.02
"""For plain SART, where the settings give none."""
MOMENTUM = 0.9
MIN_SUBSET_VIEWS = 8
"""Least size of a subset: fewer views disagree too much for this momentum."""
Phase = tuple[int, int, float, float]
"""Updates, size of their subsets over that of the first, relaxation at the start and at the end."""
PHASES: tuple[Phase, ...] = ((44, 1, 1.5, 0.7), (8, 2, 1.0, 0.5))
"""What the accelerated method does, phase by phase."""


def plain_sart(iterate: Iterate, views: int, settings: ReconstructSettings, progress: Progress | None) -> list[float]:
    """Update a volume by SART; relative residual ε of each sweep, of each view just before its update."""
    sweeps = DEFAULT_SWEEPS if settings.sweeps is None else settings.sweeps
    first = DEFAULT_RELAXATION if settings.relaxation is None else settings.relaxation
    decay = DEFAULT_DECAY if settings.decay is None else settings.decay
    order = golden_order(views)
    history: list[float] = []
    for sweep in range(sweeps):
        parts = [(np.array([view]), first * decay**sweep) for view in order]
        report = _reporter(progress, f"SART sweep {sweep + 1}/{sweeps}", sweep * views, sweeps * views)
        history.append(relative(_updated(iterate, parts, 0.0, report)))
        if _has_converged(history, settings):
            break
    return history


def accelerated(
    iterate: Iterate, views: int, progress: Progress | None, plan: tuple[Phase, ...] = PHASES
) -> list[float]:
    """Update a volume by subsets with momentum; ε of each phase, of each subset just before its update."""
    history: list[float] = []
    phases = subsets(views, plan)
    total, done = sum(len(part) for phase in phases for part, _ in phase), 0
    for number, phase in enumerate(phases, start=1):
        report = _reporter(progress, f"phase {number}/{len(phases)}", done, total)
        history.append(relative(_updated(iterate, phase, MOMENTUM, report)))
        done += sum(len(part) for part, _ in phase)
    return history


def subsets(views: int, plan: tuple[Phase, ...] = PHASES) -> list[list[tuple[Views, float]]]:
    """Subsets of views and their relaxations, phase by phase; views come in golden-ratio order, again and again."""
    order, at, phases = golden_order(views), 0, []
    for updates, times, first, last in plan:
        size = min(views, times * max(MIN_SUBSET_VIEWS, round(views / PHASES[0][0])))
        parts = [order[(at + np.arange(k * size, (k + 1) * size)) % views] for k in range(updates)]
        at += updates * size
        phases.append([(part, first * (last / first) ** (k / updates)) for k, part in enumerate(parts)])
    return phases


def _updated(
    iterate: Iterate, parts: Sequence[tuple[Views, float]], momentum: float, report: Callable[[SumOfSquares, int], None]
) -> SumOfSquares:
    """Update a volume by one subset after the other, each with its relaxation; Σ(b − A x)² and Σb² of all, ``(2,)``.

    ``report(squares so far, views so far)`` is called for each update in turn, delayed by `Iterate.ahead` updates.
    """
    squares: SumOfSquares = np.zeros(2)
    done, pending = 0, deque[tuple[SumOfSquares, int]]()

    def settle(most: int) -> None:
        nonlocal squares, done
        while len(pending) > most:
            part, count = pending.popleft()
            squares = squares + part
            done += count
            report(squares, done)

    for views, relaxation in counted(parts):
        pending.append((iterate.update(views, relaxation, momentum), len(views)))
        settle(iterate.ahead)
    settle(0)
    return squares


def _reporter(progress: Progress | None, name: str, before: int, total: int) -> Callable[[SumOfSquares, int], None]:
    """Report progress in views, with the name of the stage and ε."""

    def report(squares: SumOfSquares, done: int) -> None:
        if progress is not None:
            progress(f"{name}, ε = {relative(squares):.4f}", before + done, total)

    return report


def _has_converged(history: list[float], settings: ReconstructSettings) -> bool:
    if settings.noise is not None and history[-1] <= settings.noise:
        return True
    tolerance = DEFAULT_SWEEP_TOLERANCE if settings.tolerance is None else settings.tolerance
    return len(history) > 1 and history[-1] > history[-2] * (1 - tolerance)
