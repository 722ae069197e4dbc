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
from grainmotion.reconstructing.card import CardEquations
from grainmotion.reconstructing.equations import Equations, Views, golden_order, relative
from grainmotion.reconstructing.sart import plain_sart
from grainmotion.scan import binned
from grainmotion.volume import Volume

Progress = Callable[[str, int, int], None]

MOMENTUM = 0.9
FEWEST = 8
"""Views of a subset; fewer disagree too much for this momentum."""
PHASES = ((44, 1, 1.5, 0.7), (8, 2, 1.0, 0.5))
"""In turn: updates, size of their subsets over that of the first, relaxation at the start and at the end."""
COARSER = 2
SMALLEST = 24
"""Voxels along the grid's shortest edge and pixels along the panel's, below which there is no coarse start."""


def accelerated(equations: Equations | CardEquations, progress: Progress | None) -> tuple[Any, list[float]]:
    """The image, laid, and ε of each phase, each subset just before its update."""
    image = _start(equations)
    before = image.copy()
    history: list[float] = []
    phases = subsets(len(equations.scan))
    total, done = sum(len(views) for phase in phases for views, _ in phase), 0
    for number, phase in enumerate(phases, start=1):
        squares: Any = np.zeros(2)
        for views, relaxation in phase:
            squares = squares + equations.add_update(image, views, relaxation)
            equations.constrain_and_extrapolate(image, before, MOMENTUM)
            done += len(views)
            if progress is not None:
                progress(f"phase {number}/{len(phases)}, ε = {relative(squares):.4f}", done, total)
        history.append(relative(squares))
    return before, history


def subsets(views: int) -> list[list[tuple[Views, float]]]:
    """Of each phase the subsets of views, in golden-ratio order round and round, and their relaxations."""
    order, at, phases = golden_order(views), 0, []
    for updates, times, first, last in PHASES:
        size = min(views, times * max(FEWEST, round(views / PHASES[0][0])))
        parts = [order[(at + np.arange(k * size, (k + 1) * size)) % views] for k in range(updates)]
        at += updates * size
        phases.append([(part, first * (last / first) ** (k / updates)) for k, part in enumerate(parts)])
    return phases


def _start(equations: Equations | CardEquations) -> Any:
    """The grid's own values if it has any; else a sweep of plain SART on coarser voxels and pixels."""
    scan, grid = equations.scan, equations.grid
    if grid.array.any() or min(*grid.shape, *scan.geometry.shape) < SMALLEST:
        return equations.start()
    shape = tuple(-(-n // COARSER) for n in grid.shape)
    coarse = Volume(np.zeros(shape, np.float32), grid.voxel_size * COARSER, grid.center)
    settings = replace(equations.settings, method="sart", sweeps=1)
    rough = replace(equations, scan=binned(scan, COARSER), grid=coarse, settings=settings)
    image, _ = plain_sart(rough, None)
    finer = equations.operator.laid(_finer(rough.operator.unlaid(image), grid.shape))
    equations.constrain(finer)
    return finer


def _finer(array: Image, shape: tuple[int, ...]) -> Image:
    """Trilinear values at the middles of voxels half as large, ``shape`` of them around the same middle."""
    for axis, count in enumerate(shape):
        lines = np.moveaxis(array, axis, 0)
        # of an odd number of fine voxels the middle one lies on a coarse one's edge or middle
        at = (np.arange(count) - (count - 1) / 2) / COARSER + (len(lines) - 1) / 2
        low = np.clip(np.floor(at).astype(int), 0, max(len(lines) - 2, 0))
        weight = np.clip(at - low, 0, 1).astype(array.dtype).reshape(-1, 1, 1)
        high = np.minimum(low + 1, len(lines) - 1)
        array = np.moveaxis((1 - weight) * lines[low] + weight * lines[high], 0, axis)
    return np.ascontiguousarray(array)
