"""CudaIterate: a volume during its reconstruction on an NVIDIA GPU, with all large arrays in the memory of the GPU.

No update waits for the one before: the squares of its residual are summed on the GPU, and fetched when ε is reported.
To be imported only where numba-cuda is installed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import cast

import numpy as np

from grainmotion._typing import Float, Image
from grainmotion.kernels.cuda import volume_projection
from grainmotion.kernels.cuda.device_array import DeviceArray, upload
from grainmotion.kernels.layout import PADDING
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.projection.volume_operator_cuda import CudaVolumeOperator
from grainmotion.reconstruction.settings import ReconstructSettings
from grainmotion.reconstruction.system import SumOfSquares, Views, column_sums, cylinder_radius, lower_limit


@dataclass(frozen=True, eq=False)
class PendingSum:
    """Two sums of squares in GPU memory, to which others can be added; they are fetched when one is read."""

    parts: tuple[DeviceArray | Float, ...]
    __array_ufunc__ = None  # numpy leaves `array + PendingSum` to __radd__

    def __radd__(self, other: Float) -> PendingSum:
        return PendingSum((np.asarray(other).reshape(1, 1, 2), *self.parts))

    def __add__(self, other: PendingSum) -> PendingSum:
        fetched = "total" in self.__dict__
        return PendingSum(((self.total.reshape(1, 1, 2),) if fetched else self.parts) + other.parts)

    @cached_property
    def total(self) -> Float:
        """The sums ``(2,)``."""
        return np.sum([np.asarray(p).sum(axis=(0, 1)) for p in self.parts], axis=0)

    def __getitem__(self, index: int) -> float:
        return float(self.total[index])


class CudaIterate:
    """An image (`system.Iterate`) in single precision on the GPU, from the grid's own values."""

    ahead = 0

    def __init__(self, scan: Scan, grid: Volume, settings: ReconstructSettings) -> None:
        self.grid = Volume(grid.array.astype(np.float32, copy=False), grid.voxel_size, grid.center)
        self.operator = CudaVolumeOperator(scan.geometry, self.grid, settings.projector)
        self.radius, self.lowest = cylinder_radius(grid, settings), lower_limit(settings)
        self.column_sums = column_sums(scan.geometry, grid)
        self.image: DeviceArray = self.operator.padded(self.grid.array)
        self.before: DeviceArray | None = None
        images, valid = scan.line_integrals.astype(np.float32, copy=False), scan.valid
        self._measured = volume_projection.swapped(images)
        self._valid = volume_projection.swapped(np.ones(images.shape, np.bool_) if valid is None else valid)

    def start_from(self, planes: Iterator[Image]) -> None:
        """See `HostIterate`."""
        self.image = self.operator.padded(np.concatenate(list(planes)))
        self._constrain()

    def update(self, views: Views, relaxation: float, momentum: float = 0.0) -> SumOfSquares:
        """See `Iterate`."""
        if momentum and self.before is None:
            self.before = self.image.copy()
        squares = self.add_update(views, relaxation)
        if self.before is None:
            self._constrain()
        else:
            volume_projection.constrain_and_extrapolate(
                self.image, self.before, PADDING, self.radius, self.lowest, np.float32(momentum)
            )
        return cast("SumOfSquares", squares)  # adds up and is indexed as an array

    def add_update(self, views: Views, relaxation: float) -> PendingSum:
        """Update the image by some views, without constraints; Σ(b − A x)² and Σb² before it."""
        operator, which = self.operator, upload(np.asarray(views, np.int64))
        step = float(relaxation / self.column_sums[views].sum())
        corrections = operator.empty_images(len(views))
        squares = volume_projection.corrections(
            self.image, *operator.setup, self.radius, self._measured, self._valid, which, step, corrections
        )
        volume_projection.adjoint(corrections, *operator.setup, which, self.image)
        return PendingSum((squares,))

    def volume(self) -> Volume:
        """See `Iterate`."""
        array = self.operator.unpadded(self.image if self.before is None else self.before)
        return Volume(array, self.grid.voxel_size, self.grid.center)

    def into_volume(self) -> Volume:
        """See `Iterate`; the arrays of the GPU are no burden on the host's memory."""
        return self.volume()

    def _constrain(self) -> None:
        volume_projection.constrain(self.image, PADDING, self.radius, self.lowest)
