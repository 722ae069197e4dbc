"""Ordered subsets: updates of a volume by some views at a time; plain SART is one view at a time.

Plain SART updates by one view after the other, in golden-ratio order, with a relaxation that falls from sweep to
sweep.  It spends its later sweeps on the disagreement of single views.  Subsets of views average that, momentum
(Nesterov 1983; on ordered subsets: Kim, Ramani and Fessler 2015) makes up for the fewer updates, and a start on
coarser voxels (`coarse_start`) gives the long wavelengths.  Towards the end subsets grow and relaxation falls, which
reduces what is left of the disagreement.  Figures: decision 0012.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from grainmotion._typing import Progress
from grainmotion.reconstruction.settings import ReconstructSettings
from grainmotion.reconstruction.system import Iterate, Views, golden_order, relative


def updated(
    iterate: Iterate, parts: Iterable[tuple[Views, float]], momentum: float, tell: Callable[[Any, int], None]
) -> Any:
    """Update an image by some views after others, each with its relaxation; Σ(b − A x)² and Σb² of all, ``(2,)``.

    ``tell(squares so far, views so far)`` is called for each update in turn, some behind (`Iterate.ahead`).
    """
    squares: Any = np.zeros(2)
    done, under_way = 0, deque[tuple[Any, int]]()

    def settle(most: int) -> None:
        nonlocal squares, done
        while len(under_way) > most:
            found, count = under_way.popleft()
            squares = squares + found
            done += count
            tell(squares, done)

    for views, relaxation in parts:
        under_way.append((iterate.update(views, relaxation, momentum), len(views)))
        settle(iterate.ahead)
    settle(0)
    return squares


SWEEPS, RELAXATION, DECAY, TOLERANCE = 6, 1.0, 0.5, 0.02
"""Unless the settings say otherwise."""


def plain_sart(iterate: Iterate, views: int, settings: ReconstructSettings, progress: Progress | None) -> list[float]:
    """Update an image by a scan of so many views; ε of each sweep, each view just before its update."""
    sweeps = SWEEPS if settings.sweeps is None else settings.sweeps
    first = RELAXATION if settings.relaxation is None else settings.relaxation
    decay = DECAY if settings.decay is None else settings.decay
    order = golden_order(views)
    history: list[float] = []
    for sweep in range(sweeps):

        def tell(squares: Any, done: int, sweep: int = sweep) -> None:
            if progress is not None:
                message = f"SART sweep {sweep + 1}/{sweeps}, ε = {relative(squares):.4f}"
                progress(message, sweep * len(order) + done, sweeps * len(order))

        one_by_one = [(np.array([view]), first * decay**sweep) for view in order]
        history.append(relative(updated(iterate, one_by_one, 0.0, tell)))
        if _settled(history, settings):
            break
    return history


def _settled(history: list[float], settings: ReconstructSettings) -> bool:
    if settings.noise is not None and history[-1] <= settings.noise:
        return True
    tolerance = TOLERANCE if settings.tolerance is None else settings.tolerance
    return len(history) > 1 and history[-1] > history[-2] * (1 - tolerance)


MOMENTUM = 0.9
FEWEST = 8
"""Views of a subset; fewer disagree too much for this momentum."""
PHASES = ((44, 1, 1.5, 0.7), (8, 2, 1.0, 0.5))
"""In turn: updates, size of their subsets over that of the first, relaxation at the start and at the end."""


def accelerated(iterate: Iterate, views: int, progress: Progress | None) -> list[float]:
    """Update an image by a scan of so many views; ε of each phase, each subset just before its update."""
    history: list[float] = []
    phases = subsets(views)
    total, before = sum(len(part) for phase in phases for part, _ in phase), 0
    for number, phase in enumerate(phases, start=1):

        def tell(squares: Any, done: int, name: str = f"phase {number}/{len(phases)}", before: int = before) -> None:
            if progress is not None:
                progress(f"{name}, ε = {relative(squares):.4f}", before + done, total)

        history.append(relative(updated(iterate, phase, MOMENTUM, tell)))
        before += sum(len(part) for part, _ in phase)
    return history


def subsets(views: int) -> list[list[tuple[Views, float]]]:
    """Of each phase the subsets of views, in golden-ratio order round and round, and their relaxations."""
    order, at, phases = golden_order(views), 0, []
    for updates, times, first, last in PHASES:
        size = min(views, times * max(FEWEST, round(views / PHASES[0][0])))
        parts = [order[(at + np.arange(k * size, (k + 1) * size)) % views] for k in range(updates)]
        at += updates * size
        phases.append([(part, first * (last / first) ** (k / updates)) for k, part in enumerate(parts)])
    return phases
