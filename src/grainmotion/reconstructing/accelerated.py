"""Ordered subsets with momentum, from a start on coarser voxels.

Plain SART spends its later sweeps on what single views disagree about.  Subsets of views average that, momentum
(Nesterov 1983; on ordered subsets: Kim, Ramani and Fessler 2015) makes up for the fewer updates, and a start on
coarser voxels (`coarser`) gives the long wavelengths.  Towards the end subsets grow and relaxation falls, which
quiets what is left of the disagreement.  Figures: decision 0012.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from grainmotion.reconstructing.equations import Iterate, Views, golden_order, relative
from grainmotion.reconstructing.updates import updated

Progress = Callable[[str, int, int], None]

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
