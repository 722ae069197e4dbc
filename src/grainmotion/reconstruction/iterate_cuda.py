"""The equations of a scan on a grid, on an NVIDIA card: as `equations`, with all that is large kept there.

No update waits for the one before: what it leaves unexplained is summed on the card, and asked for by who tells ε.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from grainmotion._typing import Float
from grainmotion.kernels.layout import PADDING
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.projection.volume_operator_cuda import CARD, CudaVolumeOperator, PendingSum
from grainmotion.reconstruction.settings import ReconstructSettings
from grainmotion.reconstruction.system import NO_LIMIT, Views, column_sums


@dataclass(frozen=True, eq=False)
class CudaSystem:
    """A scan on a grid, in single precision, on the card."""

    scan: Scan
    grid: Volume
    settings: ReconstructSettings

    @cached_property
    def operator(self) -> CudaVolumeOperator:
        """A."""
        grid = Volume(self.grid.array.astype(np.float32, copy=False), self.grid.voxel_size, self.grid.center)
        return CudaVolumeOperator(self.scan.geometry, grid, self.settings.projector)

    @cached_property
    def radius(self) -> float:
        """Radius of the grid's inscribed upright cylinder, voxels; 0 for none."""
        return min(self.grid.shape[1:]) / 2 if self.settings.circular else 0.0

    @cached_property
    def lowest(self) -> np.float32:
        """The least attenuation that is allowed."""
        return np.float32(0) if self.settings.non_negative else NO_LIMIT

    @cached_property
    def column_sums(self) -> Float:
        """C of each view."""
        return column_sums(self.scan.geometry, self.grid)

    @cached_property
    def measured(self) -> tuple[Any, Any]:
        """All radiographs, and which of their pixels count."""
        images, valid = self.scan.line_integrals.astype(np.float32, copy=False), self.scan.valid
        swapped = self.operator.kernels.swapped
        return swapped(images), swapped(np.ones(images.shape, np.bool_) if valid is None else valid)

    def start(self) -> Any:
        """The grid's own values, laid."""
        return self.operator.laid(self.operator.grid.array)

    def add_update(self, image: Any, views: Views, relaxation: float) -> PendingSum:
        """Update an image by some views in place, without constraints; Σ(b − A x)² and Σb² before it."""
        operator, which = self.operator, CARD.hold(np.asarray(views, np.int64))
        step = float(relaxation / self.column_sums[views].sum())
        corrections = operator.images(len(views))
        squares = operator.kernels.corrections(
            image, *operator.place, self.radius, *self.measured, which, step, corrections
        )
        operator.kernels.adjoint(corrections, *operator.place, which, image)
        return PendingSum((squares,))

    def constrain(self, image: Any) -> None:
        """Clip an image at zero, inside its cylinder, in place (see the settings)."""
        self.operator.kernels.constrain(image, PADDING, self.radius, self.lowest)

    def constrain_and_extrapolate(self, image: Any, before: Any, momentum: float) -> None:
        """Constrain an image x, leave x in ``before`` and x + momentum · (x − before) in ``image``."""
        self.operator.kernels.constrain_and_extrapolate(
            image, before, PADDING, self.radius, self.lowest, np.float32(momentum)
        )

    def volume(self, image: Any) -> Volume:
        """A laid image on the grid."""
        return Volume(self.operator.unlaid(image), self.grid.voxel_size, self.grid.center)
