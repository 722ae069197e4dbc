"""Ordered subsets with momentum, from a start on coarser voxels.

Plain SART spends its later sweeps on what single views disagree about.  Subsets of views average that, momentum
(Nesterov 1983; on ordered subsets: Kim, Ramani and Fessler 2015) makes up for the fewer updates, and voxels twice
as large, seen by pixels twice as large, give the long wavelengths for a sixteenth of a sweep.  Towards the end
subsets grow and relaxation falls, which quiets what is left of the disagreement.  Figures: decision 0012.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from grainmotion.packed import Image
from grainmotion.reconstructing.coarser import COARSER
from grainmotion.reconstructing.equations import Iterate, Views, golden_order, relative
from grainmotion.reconstructing.held import Held, HeldOnCard, held
from grainmotion.reconstructing.sart import plain_sart
from grainmotion.reconstructing.settings import ReconstructSettings
from grainmotion.reconstructing.slabs import Layout
from grainmotion.reconstructing.updates import updated
from grainmotion.scan import Scan, binned
from grainmotion.volume import Volume

Progress = Callable[[str, int, int], None]

MOMENTUM = 0.9
FEWEST = 8
"""Views of a subset; fewer disagree too much for this momentum."""
PHASES = ((44, 1, 1.5, 0.7), (8, 2, 1.0, 0.5))
"""In turn: updates, size of their subsets over that of the first, relaxation at the start and at the end."""
SMALLEST = 24
"""Voxels along the grid's shortest edge and pixels along the panel's, below which there is no coarse start."""


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


def has_coarse_start(shape: tuple[int, ...], panel: tuple[int, int]) -> bool:
    """Whether a grid of zeros of some shape and a panel are large enough for a coarse start."""
    return min(*shape, *panel) >= SMALLEST


def coarse_start(rough: Scan, grid: Volume | Layout, settings: ReconstructSettings) -> Image:
    """A sweep of plain SART on coarser voxels; ``rough`` is the scan `binned` by as much."""
    shape = tuple(-(-n // COARSER) for n in grid.shape)
    coarse = Volume(np.zeros(shape, np.float32), grid.voxel_size * COARSER, grid.center)
    once = replace(settings, method="sart", sweeps=1)
    iterate = held(rough, coarse, once)
    plain_sart(iterate, len(rough), once, None)
    return iterate.volume().array


def started(scan: Scan, grid: Volume, settings: ReconstructSettings) -> Held | HeldOnCard:
    """From the grid's own values if it has any, or from a coarse start."""
    iterate = held(scan, grid, settings)
    if not grid.array.any() and has_coarse_start(grid.shape, scan.geometry.shape):
        iterate.start_from(coarse_start(binned(scan, COARSER), grid, settings))
    return iterate
