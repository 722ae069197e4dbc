"""CudaVolumeOperator: the line integrals A x of a whole volume and the adjoint Aᵀ y on an NVIDIA GPU.

As `volume_operator.VolumeOperator`, but volumes and images stay in GPU memory; only what is asked for comes back.
Volumes lie with z fastest and images with rows fastest, whatever the views (see `kernels.cuda.volume_projection`).
To be imported only where numba-cuda is installed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from grainmotion._typing import Image, Projector
from grainmotion.kernels.cuda import volume_projection
from grainmotion.kernels.cuda.device_array import DeviceArray, empty, upload
from grainmotion.kernels.layout import PADDING
from grainmotion.model.geometry import Geometry
from grainmotion.model.volume import Volume
from grainmotion.projection.volume_operator import pad, padded_origin


@dataclass(frozen=True, eq=False)
class CudaVolumeOperator:
    """A volume's projection to some views as a linear operator on the GPU.

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
    def setup(self) -> tuple[DeviceArray, float, DeviceArray, bool, bool]:
        """Arguments of the kernels: origin, voxel size, vectors, cone or not, exact path or not."""
        vectors, origin = volume_projection.axes_renamed(self.geometry.vectors, padded_origin(self.grid))
        cone, exact = self.geometry.beam == "cone", self.projector == "exact"
        return upload(origin), self.grid.voxel_size, upload(vectors), cone, exact

    def padded(self, array: Image) -> DeviceArray:
        """A volume's ``[z, y, x]`` values with empty layers around, on the GPU (a copy)."""
        return volume_projection.z_fastest(pad(array))

    def unpadded(self, image: DeviceArray) -> Image:
        """The ``[z, y, x]`` values of a padded volume, on the host."""
        inner = slice(PADDING, -PADDING)
        return np.ascontiguousarray(volume_projection.x_fastest(image)[inner, inner, inner])

    def empty_images(self, count: int) -> DeviceArray:
        """Room for so many images on the GPU, columns before rows."""
        rows, columns = self.geometry.shape
        return empty((count, columns, rows), self.grid.array.dtype)

    def forward(self, image: DeviceArray) -> Image:
        """A x of all views from a padded volume: line integrals ``(views, rows, columns)`` on the host."""
        images = self.empty_images(len(self.geometry))
        volume_projection.forward(image, *self.setup, images)
        return np.asarray(volume_projection.swapped(images))

    def add_adjoint(self, images: Image, out: DeviceArray) -> None:
        """Add Aᵀ y of all views to a padded volume, for ``images (views, rows, columns)`` of the host."""
        swapped = volume_projection.swapped(np.ascontiguousarray(images, self.grid.array.dtype))
        volume_projection.adjoint(swapped, *self.setup, np.arange(len(self.geometry)), out)
