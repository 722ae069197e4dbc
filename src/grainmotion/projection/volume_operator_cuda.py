"""CardOperator: the line integrals A x of a whole volume and the adjoint Aᵀ y on an NVIDIA card.

As `volume_operator.VolumeOperator`, but volumes and images stay on the card; only what is asked for comes back.
Volumes lie with z fastest and images with rows fastest, whatever the views (see `kernels.cuda.volume_projection`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Image, Projector
from grainmotion.backends.device import Device
from grainmotion.kernels.layout import PADDING
from grainmotion.model.geometry import Geometry
from grainmotion.model.volume import Volume
from grainmotion.projection.volume_operator import pad, padded_origin

CARD = Device("cuda")


@dataclass(frozen=True, eq=False)
class CudaVolumeOperator:
    """A volume's projection to some views as a linear operator on the card.

    Attributes
    ----------
    geometry : Geometry
        Views to project to.
    grid : Volume
        Where the voxels are; its values are not used, its precision is.
    projector : {"trilinear", "exact"}
        See `volume_operator.Projector`.
    """

    geometry: Geometry
    grid: Volume
    projector: Projector = "trilinear"

    @cached_property
    def kernels(self) -> ModuleType:
        """Those of whole volumes."""
        return CARD.kernels("volume_projection")

    @cached_property
    def place(self) -> tuple[Any, float, Any, bool, bool]:
        """What the kernels ask of grid and views: origin, voxel size, vectors, cone or not, exact path or not."""
        vectors, origin = self.kernels.turned(self.geometry.vectors, padded_origin(self.grid))
        cone, exact = self.geometry.beam == "cone", self.projector == "exact"
        return CARD.hold(origin), self.grid.voxel_size, CARD.hold(vectors), cone, exact

    def laid(self, array: Image) -> Any:
        """A volume's ``[z, y, x]`` values with empty layers around, on the card (a copy)."""
        return self.kernels.laid(pad(array))

    def unlaid(self, image: Any) -> Image:
        """The ``[z, y, x]`` values of a laid volume, on the host."""
        inner = slice(PADDING, -PADDING)
        return np.ascontiguousarray(self.kernels.unlaid(image)[inner, inner, inner])

    def images(self, count: int) -> Any:
        """Room on the card for so many images, columns before rows."""
        rows, columns = self.geometry.shape
        return CARD.kernels("device_array").empty((count, columns, rows), self.grid.array.dtype)

    def forward(self, image: Any) -> Image:
        """A x of all views from a laid volume: line integrals ``(views, rows, columns)`` on the host."""
        held = self.images(len(self.geometry))
        self.kernels.forward(image, *self.place, held)
        return np.asarray(self.kernels.swapped(held))

    def add_adjoint(self, images: Image, out: Any) -> None:
        """Add Aᵀ y of all views to a laid volume, for ``images (views, rows, columns)`` of the host."""
        held = self.kernels.swapped(np.ascontiguousarray(images, self.grid.array.dtype))
        self.kernels.adjoint(held, *self.place, np.arange(len(self.geometry)), out)


@dataclass(frozen=True, eq=False)
class PendingSum:
    """Sums of squares that lie on the card until somebody looks: added to each other they stay there."""

    parts: tuple[Any, ...]
    __array_ufunc__ = None  # a host's array that these are added to becomes a sum of the card

    def __radd__(self, other: NDArray[np.float64]) -> PendingSum:
        return PendingSum((np.asarray(other).reshape(1, 1, 2), *self.parts))

    def __add__(self, other: PendingSum) -> PendingSum:
        looked = "total" in self.__dict__  # then there is nothing to wait for
        return PendingSum(((self.total.reshape(1, 1, 2),) if looked else self.parts) + other.parts)

    @cached_property
    def total(self) -> NDArray[np.float64]:
        """The sums ``(2,)``."""
        return np.sum([np.asarray(p).sum(axis=(0, 1)) for p in self.parts], axis=0)

    def __getitem__(self, index: int) -> float:
        return float(self.total[index])
