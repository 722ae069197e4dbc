"""A volume during its reconstruction in this process, on the CPU or on a GPU."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from grainmotion._typing import Float, Image
from grainmotion.backends.device import uses_cuda
from grainmotion.model.large_arrays import large_copy, large_empty
from grainmotion.model.progress import reached
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.reconstruction import slabs
from grainmotion.reconstruction.settings import ReconstructSettings
from grainmotion.reconstruction.slabs import Layout, RadiographRows, Slab
from grainmotion.reconstruction.system import Views, column_sums

if TYPE_CHECKING:
    from grainmotion.reconstruction.iterate_cuda import CudaIterate


@dataclass(eq=False)
class HostIterate:
    """A volume (`system.Iterate`) in slabs, with the scan that it is fitted to."""

    scan: Scan
    layout: Layout
    sums: Float
    slabs: list[Slab]
    ahead = 0

    @classmethod
    def of(cls, scan: Scan, grid: Volume, settings: ReconstructSettings) -> HostIterate:
        """Start at the grid's own values."""
        layout, array = Layout.of(grid, scan.geometry, settings), grid.array.astype(np.float32, copy=False)
        parts = [slabs.new_slab(layout, k, array[slice(*planes)]) for k, planes in enumerate(layout.slabs)]
        return cls(scan, layout, column_sums(scan.geometry, grid), parts)

    def start_from(self, planes: Iterator[Image]) -> None:
        """Replace the values of each slab by ``[z, y, x]`` arrays of its planes, constrained."""
        for k, (slab, array) in enumerate(zip(self.slabs, planes, strict=True)):
            self.slabs[k] = slabs.slab_from(self.layout, k, slab.imaging.grid.array, array)

    def update(self, views: Views, relaxation: float, momentum: float = 0.0) -> Float:
        """See `Iterate`."""
        if momentum and self.slabs[0].before is None:
            self.slabs = [replace(slab, before=large_copy(slab.image)) for slab in self.slabs]
        strips = [slabs.forward(slab, views) for slab in self.slabs]
        valid = None if self.scan.valid is None else self.scan.valid[views]
        measured = RadiographRows(0, self.scan.line_integrals[views].astype(np.float32, copy=False), valid)
        step = float(relaxation / self.sums[views].sum())
        corrections = slabs.compare(self.layout, views, strips, measured, step)
        for slab in self.slabs:
            slabs.advance(slab, corrections, views, momentum)
        return slabs.total([corrections.squares], [(0, len(corrections.squares))])

    def volume(self) -> Volume:
        """See `Iterate`."""
        array = large_empty(self.layout.shape, np.float32)
        for slab, planes in zip(self.slabs, self.layout.slabs, strict=True):
            array[slice(*planes)] = slab.planes
        return Volume(array, self.layout.voxel_size, self.layout.center)

    def into_volume(self) -> Volume:
        """See `Iterate`."""
        for k, slab in enumerate(self.slabs):
            reached(0.0)  # gigabytes are moved
            self.slabs[k] = slab.constrained
        array = large_empty(self.layout.shape, np.float32)
        for planes in self.layout.slabs:
            reached(0.0)
            array[slice(*planes)] = self.slabs.pop(0).planes
        return Volume(array, self.layout.voxel_size, self.layout.center)


def new_iterate(scan: Scan, grid: Volume, settings: ReconstructSettings) -> HostIterate | CudaIterate:
    """A volume on the device of the settings, at the grid's own values."""
    if not uses_cuda(settings.device):
        return HostIterate.of(scan, grid, settings)
    from grainmotion.reconstruction.iterate_cuda import CudaIterate

    return CudaIterate(scan, grid, settings)
