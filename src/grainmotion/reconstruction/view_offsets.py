"""Offsets of whole radiographs, from a small reconstruction in which each view has an unknown offset.

A beam that is brighter or dimmer in one view than in the flats adds a constant δ to the line integrals of that view.
With one unknown δ a view, the offsets that fit a volume x best are the means of b − A x over the view's pixels.  They
are eliminated: before each update of SART the mean is subtracted, so that the volume, and δ up to a constant, do not
depend on offsets of the radiographs at all.  The constant that all views have in common is not determined: a uniform
disc imitates it.  Figures: decision 0026.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float, Image
from grainmotion.model.progress import counted
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.reconstruction import slabs
from grainmotion.reconstruction.iterate import HostIterate
from grainmotion.reconstruction.settings import ReconstructSettings
from grainmotion.reconstruction.slabs import RadiographRows, Strip
from grainmotion.reconstruction.system import golden_order

SWEEPS = 2
"""Sweeps of SART: after two the offsets differ by less than 0.0002 from those after four (decision 0026)."""
OFFSET_DECAY = 0.5
"""Factor on the relaxation after each sweep."""
MIN_CHORD_SHARE = 0.05
"""Rays with a shorter path in the grid, over the longest one, are no part of the fit."""


def fitted_offsets(scan: Scan, grid: Volume, settings: ReconstructSettings) -> Float:
    """Offset of each view ``(views,)``, up to a constant that all have in common."""
    iterate = HostIterate.of(scan, grid, replace(settings, device="cpu"))
    used = _crossing(iterate)
    order = golden_order(len(scan))
    for sweep in counted(range(SWEEPS)):
        for view in counted(order):
            _update(iterate, int(view), used, OFFSET_DECAY**sweep)
    differences = (scan.line_integrals[view] - _simulated(iterate, view) for view in counted(range(len(scan))))
    return np.array([d[pixels].mean(dtype=float) for d, pixels in zip(differences, used, strict=True)])


def _update(iterate: HostIterate, view: int, used: NDArray[np.bool_], relaxation: float) -> None:
    """One view's update of SART with that view's offset eliminated."""
    views, layout = np.array([view]), iterate.layout
    strips = [slabs.forward(slab, views) for slab in iterate.slabs]
    measured = iterate.scan.line_integrals[view]
    offset = (measured - _sum(strips, measured.shape))[used[view]].mean(dtype=float)
    levelled = (measured - offset).astype(np.float32)
    step = float(relaxation / iterate.sums[view])
    rows = RadiographRows(0, levelled[None], used[views])
    corrections = slabs.compare(layout, views, strips, rows, step)
    for slab in iterate.slabs:
        slabs.advance(slab, corrections, views, 0.0)


def _simulated(iterate: HostIterate, view: int) -> Image:
    """Line integrals A x of one view."""
    strips = [slabs.forward(slab, np.array([view])) for slab in iterate.slabs]
    return _sum(strips, iterate.scan.geometry.shape)


def _sum(strips: list[Strip], shape: tuple[int, ...]) -> Image:
    """The line integrals of all slabs of one view."""
    total = np.zeros(shape, np.float32)
    for strip in strips:
        total[strip.first : strip.first + strip.images.shape[1]] += strip.images[0]
    return total


def _crossing(iterate: HostIterate) -> NDArray[np.bool_]:
    """Good pixels whose rays cross the grid; of a view that has none, all good ones."""
    scan, layout = iterate.scan, iterate.layout
    used = np.ones(scan.line_integrals.shape, np.bool_) if scan.valid is None else scan.valid.copy()
    ones = Volume(np.ones(layout.shape, np.float32), layout.voxel_size, layout.center)
    full = HostIterate.of(scan, ones, layout.settings)
    for slab in full.slabs:
        slab.imaging.constrain(slab.image)
    for view in range(len(scan)):
        chords = _simulated(full, view)
        crossing = used[view] & (chords > MIN_CHORD_SHARE * chords.max())
        if crossing.any():
            used[view] = crossing
    return used
