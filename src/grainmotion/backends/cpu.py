"""The CPU as a backend: numba's kernels on the arrays of this process."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numba as nb
import numpy as np
from numpy.typing import ArrayLike

from grainmotion._typing import Float, Image, Index
from grainmotion.backends.base import BackendArray, Grains, ImageStacks, PatchBackend, Settings
from grainmotion.backends.image_sums import in_precision
from grainmotion.kernels import filters, grain_projection, normal_equations, stretched_grain_projection
from grainmotion.kernels.layout import GrainTable, PatchTable, ViewTable
from grainmotion.model.compact_volume import CompactVoxels
from grainmotion.model.pose import Pose
from grainmotion.model.progress import counted, reached

LINES_OF_A_PART = 100_000
"""Lines of patches that are traced in one call, some tenths of a second."""
VOXELS_OF_A_THREAD, MAX_VOXELS_OF_A_PART = 1 << 19, 1 << 22
"""Voxels of compact grains that are written for one call, for each thread: 2 MB, which are still in its cache when
rays read them; and for all threads."""
STACKS_AT_ONCE = 4
"""Stacks of radiographs that one pass over the derivatives multiplies: these are read from memory once."""
PATCHES_OF_A_PART = 1 << 14
"""Patches that are filtered in one call, some tenths of a second."""


@dataclass(frozen=True)
class CpuBackend:
    """A `PatchBackend`; its arrays are numpy's."""

    places_coarse_grains = False
    takes_compact_voxels = True

    def place_voxels(
        self, voxels: Image | CompactVoxels, starts: Index, heights: Float, relative_size: float
    ) -> tuple[PatchBackend, object]:
        return self, voxels

    def place_patches(self, patches: PatchTable) -> PatchTable:
        return patches

    def project(self, grains: GrainTable, views: ViewTable, patches: PatchTable, exact: bool) -> Image:
        values = np.zeros(patches.offsets[-1], _precision(grains))
        kernels = grain_projection if grains.stretches is None else stretched_grain_projection
        for some, lines in parts(grains, patches):
            kernels.project(some, views, patches._replace(lines=lines), exact, values)
        return values

    def project_with_derivatives(
        self, grains: GrainTable, views: ViewTable, patches: PatchTable, exact: bool
    ) -> tuple[Image, Image]:
        pixels, dtype = patches.offsets[-1], _precision(grains)
        values, derivatives = np.zeros(pixels, dtype), np.zeros((6, pixels), dtype)
        if grains.stretches is not None:
            return self.project_with_strain_derivatives(grains, views, patches, exact)[:2]
        for some, lines in parts(grains, patches):
            table = patches._replace(lines=lines)
            grain_projection.project_with_derivatives(some, views, table, exact, values, derivatives)
        return values, derivatives

    def project_with_strain_derivatives(
        self, grains: GrainTable, views: ViewTable, patches: PatchTable, exact: bool
    ) -> tuple[Image, Image, Image]:
        """Line integrals of stretched grains, and their derivatives by u and δ and by the strains."""
        pixels, dtype = patches.offsets[-1], _precision(grains)
        values, derivatives, by_strain = (
            np.zeros(pixels, dtype),
            np.zeros((6, pixels), dtype),
            np.zeros((6, pixels), dtype),
        )
        for some, lines in parts(grains, patches):
            stretched_grain_projection.project_with_derivatives(
                some, views, patches._replace(lines=lines), exact, values, derivatives, by_strain
            )
        return values, derivatives, by_strain

    def add_patches(self, values: BackendArray, patches: PatchTable, shape: tuple[int, int, int]) -> Image:
        images = np.zeros(shape)  # sums of single numbers are exact in double precision, whatever their order
        grain_projection.add_patches(values, patches.boxes, patches.offsets, images)
        return in_precision(images, values.dtype)

    def filter_images(self, images: Image, kernel: Image) -> None:
        filters.filter_images(images, _as_precise(kernel, images))

    def filter_patches(self, derivatives: BackendArray, patches: PatchTable, factor: Image, kernel: Image) -> None:
        weights = _as_precise(kernel, derivatives)
        for k in counted(range(0, len(patches.boxes), PATCHES_OF_A_PART)):
            end = k + PATCHES_OF_A_PART
            filters.filter_patches(derivatives, patches.boxes[k:end], patches.offsets[k : end + 1], factor, weights)

    def vjp(self, derivatives: BackendArray, patches: PatchTable, stacks: ImageStacks | Sequence[Image]) -> Float:
        out, some = np.zeros((len(stacks), len(patches.boxes), 6)), list(stacks)
        tables = derivatives, patches.boxes, patches.offsets
        for k in range(0, len(some), STACKS_AT_ONCE):
            group = slice(k, k + STACKS_AT_ONCE)
            reached(0.0)  # of 29,000 grains each pass takes a second or more
            normal_equations.vjp(*tables, _stacked(some[group]), out[group])
        return out

    def jvp(
        self, derivatives: BackendArray, patches: PatchTable, increments: Float, shape: tuple[int, int, int]
    ) -> list[Image]:
        tables, stacks = (patches.boxes, patches.offsets, patches.order, patches.view_starts), list[Image]()
        for k in range(0, len(increments), STACKS_AT_ONCE):
            some = increments[k : k + STACKS_AT_ONCE]
            images = np.empty((len(some), *shape))
            reached(0.0)
            normal_equations.jvp(derivatives, *tables, some, images)
            stacks += list(in_precision(images, derivatives.dtype))
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


def parts(grains: GrainTable, patches: PatchTable) -> Iterator[tuple[GrainTable, Index]]:
    """The grains with all that a kernel needs to trace some of the patches' lines, and these, part by part.

    Parts are small, so that progress is told between them and compact voxels are written for a few grains at a time.
    """
    lines = patches.lines
    if not isinstance(grains.voxels, CompactVoxels):
        for k in counted(range(0, len(lines), LINES_OF_A_PART)):
            yield grains, lines[k : k + LINES_OF_A_PART]
        return
    owners = patches.boxes[lines[:, 0], 0]  # patches follow their grains
    sizes = grains.shapes.prod(axis=1)
    tops = np.cumsum(np.where(np.diff(grains.starts, prepend=-1) != 0, sizes, 0))  # rows of one grain share its voxels
    most = min(VOXELS_OF_A_THREAD * nb.get_num_threads(), MAX_VOXELS_OF_A_PART)
    cuts = np.searchsorted(tops, np.arange(most, tops[-1], most))
    firsts = np.unique([0, *cuts.tolist(), len(tops)])
    buffer = np.empty(0, grains.voxels.dtype)  # one for all parts: new memory costs more than to write the voxels
    for first, end in counted(list(pairwise(firsts.tolist()))):
        own = slice(*np.searchsorted(owners, [first, end]))
        if own.start == own.stop:
            continue
        rows, which = np.unique(grains.starts[first:end], return_inverse=True)
        ends = np.cumsum([grains.voxels.volumes[row].size for row in rows])
        begins = np.concatenate([[0], ends[:-1]])
        if len(buffer) < ends[-1]:
            buffer = np.empty(ends[-1], buffer.dtype)
        for row, begin, stop in zip(rows, begins, ends, strict=True):
            grains.voxels.volumes[row].write(buffer[begin:stop])
        starts = np.zeros_like(grains.starts)
        starts[first:end] = begins[which]
        yield grains._replace(voxels=buffer, starts=starts), lines[own]


def _stacked(images: Sequence[ArrayLike]) -> Image:
    """Stacks of radiographs in one array, without a copy of a single one."""
    return np.asarray(images[0])[None] if len(images) == 1 else np.stack([np.asarray(image) for image in images])


def _precision(grains: GrainTable) -> np.dtype[np.floating]:
    """The precision of the grains' voxels."""
    voxels = grains.voxels
    return voxels.dtype if isinstance(voxels, CompactVoxels) else np.asarray(voxels).dtype


def _as_precise(kernel: Image, values: BackendArray) -> Image:
    """A kernel in the precision of what it filters, if that is higher, so that one combination is compiled."""
    return kernel.astype(np.promote_types(kernel.dtype, values.dtype), copy=False)


CPU = CpuBackend()
