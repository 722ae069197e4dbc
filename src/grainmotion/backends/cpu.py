"""The CPU as a backend: numba's kernels on the arrays of this process."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from grainmotion._typing import Float, Image, Index
from grainmotion.backends.base import BackendArray, Grains, ImageStacks, PatchBackend, Settings
from grainmotion.kernels import filters, grain_projection, normal_equations, stretched_grain_projection
from grainmotion.kernels.layout import GrainTable, PatchTable, ViewTable
from grainmotion.model.pose import Pose


@dataclass(frozen=True)
class CpuBackend:
    """A `PatchBackend`; its arrays are numpy's."""

    places_coarse_grains = False

    def place_voxels(
        self, voxels: Image, starts: Index, heights: Float, relative_size: float
    ) -> tuple[PatchBackend, object]:
        return self, voxels

    def place_patches(self, patches: PatchTable) -> PatchTable:
        return patches

    def project(self, grains: GrainTable, views: ViewTable, patches: PatchTable, exact: bool) -> Image:
        values = np.zeros(patches.offsets[-1], np.asarray(grains.voxels).dtype)
        kernels = grain_projection if grains.stretches is None else stretched_grain_projection
        kernels.project(grains, views, patches, exact, values)
        return values

    def project_with_derivatives(
        self, grains: GrainTable, views: ViewTable, patches: PatchTable, exact: bool
    ) -> tuple[Image, Image]:
        pixels, dtype = patches.offsets[-1], np.asarray(grains.voxels).dtype
        values, derivatives = np.zeros(pixels, dtype), np.zeros((6, pixels), dtype)
        if grains.stretches is not None:
            return self.project_with_strain_derivatives(grains, views, patches, exact)[:2]
        grain_projection.project_with_derivatives(grains, views, patches, exact, values, derivatives)
        return values, derivatives

    def project_with_strain_derivatives(
        self, grains: GrainTable, views: ViewTable, patches: PatchTable, exact: bool
    ) -> tuple[Image, Image, Image]:
        """Line integrals of stretched grains, and their derivatives by u and δ and by the strains."""
        pixels, dtype = patches.offsets[-1], np.asarray(grains.voxels).dtype
        values, derivatives, by_strain = (
            np.zeros(pixels, dtype),
            np.zeros((6, pixels), dtype),
            np.zeros((6, pixels), dtype),
        )
        stretched_grain_projection.project_with_derivatives(
            grains, views, patches, exact, values, derivatives, by_strain
        )
        return values, derivatives, by_strain

    def add_patches(self, values: BackendArray, patches: PatchTable, shape: tuple[int, int, int]) -> Image:
        images = np.zeros(shape)  # sums of single numbers are exact in double precision, whatever their order
        grain_projection.add_patches(values, patches.boxes, patches.offsets, images)
        return images.astype(values.dtype, copy=False)

    def filter_images(self, images: Image, kernel: Image) -> None:
        filters.filter_images(images, _as_precise(kernel, images))

    def filter_patches(self, derivatives: BackendArray, patches: PatchTable, factor: Image, kernel: Image) -> None:
        weights = _as_precise(kernel, derivatives)
        filters.filter_patches(derivatives, patches.boxes, patches.offsets, factor, weights)

    def vjp(self, derivatives: BackendArray, patches: PatchTable, stacks: ImageStacks | Sequence[Image]) -> Float:
        out = np.zeros((len(stacks), len(patches.boxes), 6))
        for images, dots in zip(stacks, out, strict=True):
            normal_equations.vjp(derivatives, patches.boxes, patches.offsets, images, dots)
        return out

    def jvp(
        self, derivatives: BackendArray, patches: PatchTable, increments: Float, shape: tuple[int, int, int]
    ) -> list[Image]:
        tables, stacks = (patches.boxes, patches.offsets, patches.order, patches.view_starts), list[Image]()
        for each in increments:
            images = np.empty(shape)
            normal_equations.jvp(derivatives, *tables, each, images)
            stacks.append(images.astype(derivatives.dtype, copy=False))
        return stacks

    def gram_blocks(self, derivatives: BackendArray, patches: PatchTable, pairs: Index, first: Index) -> Float:
        out = np.empty((len(first) - 1, 6, 6))
        normal_equations.gram_blocks(derivatives, patches.boxes, patches.offsets, pairs, first, out)
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


def _as_precise(kernel: Image, values: BackendArray) -> Image:
    """A kernel in the precision of what it filters, if that is higher, so that one combination is compiled."""
    return kernel.astype(np.promote_types(kernel.dtype, values.dtype), copy=False)


CPU = CpuBackend()
