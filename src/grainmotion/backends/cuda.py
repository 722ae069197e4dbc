"""An NVIDIA GPU as a backend: numba-cuda's kernels; what is large stays in its memory.

To be imported only where numba-cuda is installed (`device.backend_of`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from grainmotion._typing import Float, Image, Index
from grainmotion.backends.base import BackendArray, Grains, ImageStacks, PatchBackend, Settings
from grainmotion.kernels.cuda import filters, grain_projection, normal_equations
from grainmotion.kernels.cuda.device_array import DeviceArray, empty, upload, zeros
from grainmotion.kernels.layout import GrainTable, PatchTable, ViewTable
from grainmotion.model.compact_volume import CompactVoxels
from grainmotion.model.pose import Pose


@dataclass(frozen=True)
class CudaBackend:
    """A `PatchBackend`; its arrays are `DeviceArray`."""

    places_coarse_grains = False
    takes_compact_voxels = False

    def place_voxels(
        self, voxels: Image | CompactVoxels, starts: Index, heights: Float, relative_size: float
    ) -> tuple[PatchBackend, object]:
        return self, upload(voxels)

    def place_patches(self, patches: PatchTable) -> PatchTable:
        boxes, offsets, lines, *by_view = patches
        return PatchTable(upload(boxes), upload(offsets), lines, *map(upload, by_view))  # lines are used once

    def project(self, grains: GrainTable, views: ViewTable, patches: PatchTable, exact: bool) -> DeviceArray:
        values = zeros((int(patches.offsets[-1]),), _resident(grains).dtype)
        grain_projection.project(grains, views, patches, exact, values)
        return values

    def project_with_derivatives(
        self, grains: GrainTable, views: ViewTable, patches: PatchTable, exact: bool
    ) -> tuple[DeviceArray, DeviceArray]:
        pixels, dtype = int(patches.offsets[-1]), _resident(grains).dtype
        values, derivatives = zeros((pixels,), dtype), zeros((6, pixels), dtype)
        grain_projection.project_with_derivatives(grains, views, patches, exact, values, derivatives)
        return values, derivatives

    def add_patches(self, values: BackendArray, patches: PatchTable, shape: tuple[int, int, int]) -> Image:
        images = np.zeros(shape, values.dtype)
        grain_projection.add_patches(values, patches, images)
        return images

    def filter_images(self, images: Image, kernel: Image) -> None:
        filters.filter_images(images, kernel)

    def filter_patches(self, derivatives: BackendArray, patches: PatchTable, factor: Image, kernel: Image) -> None:
        filters.filter_patches(derivatives, patches, factor, kernel)

    def vjp(self, derivatives: BackendArray, patches: PatchTable, stacks: ImageStacks | Sequence[Image]) -> Float:
        out = np.zeros((len(stacks), len(patches.boxes), 6))
        for images, dots in zip(stacks, out, strict=True):
            normal_equations.vjp(derivatives, patches, images, dots)
        return out

    def jvp(
        self, derivatives: BackendArray, patches: PatchTable, increments: Float, shape: tuple[int, int, int]
    ) -> list[DeviceArray]:
        stacks = [empty(shape, derivatives.dtype) for _ in increments]
        for each, images in zip(increments, stacks, strict=True):
            normal_equations.jvp(derivatives, patches, each, images)
        return stacks

    def gram_blocks(self, derivatives: BackendArray, patches: PatchTable, pairs: Index, first: Index) -> Float:
        out = np.zeros((len(first) - 1, 6, 6))
        normal_equations.gram_blocks(derivatives, patches, pairs, first, out)
        return out

    def map_grains(
        self,
        function: Callable[[Grains, Pose, tuple[Image, ...], Settings], Float],
        grains: Grains,
        pose: Pose,
        images: tuple[Image, ...],
        settings: Settings,
    ) -> Float:
        return function(grains, pose, images, settings)


def _resident(grains: GrainTable) -> DeviceArray:
    assert isinstance(grains.voxels, DeviceArray)
    return grains.voxels
