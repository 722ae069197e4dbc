"""Tasks of tracking: plain functions of a piece of the sample, some grains each, that workers run.

Patches are tables (`kernels.layout.PatchTable`) of a piece's own, in which grains count within the piece.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from grainmotion._typing import Float, Image, Index
from grainmotion.backends.cpu import CPU
from grainmotion.backends.image_sums import in_precision
from grainmotion.cluster.shared_store import StoredImages, StoredObject
from grainmotion.cluster.worker_threads import use_worker_threads
from grainmotion.kernels import grain_projection, normal_equations
from grainmotion.kernels.layout import GrainTable, PatchTable, ViewTable
from grainmotion.model.pose import Pose


@dataclass(frozen=True, eq=False)
class Rays:
    """Arguments of `PatchBackend.project`; the grains' voxels are the worker's."""

    grains: GrainTable
    views: ViewTable
    patches: PatchTable
    exact: bool

    @property
    def fixed_views(self) -> ViewTable:
        """The views, read-only as those of a geometry, which pickling forgets: kernels are compiled once for both."""
        vectors = self.views.vectors.view()
        vectors.setflags(write=False)
        return self.views._replace(vectors=vectors)


@dataclass(frozen=True, eq=False)
class ProjectedPatches:
    """Line integrals of all patches, flat, and their derivatives ``(6, pixels)``."""

    values: Image
    derivatives: Image


Piece = Image | ProjectedPatches
"""What a worker holds of the patches: line integrals or derivatives alone, or both."""


@dataclass(frozen=True, eq=False)
class ImageStrip:
    """k stacks of radiographs ``(k, views, rows, columns)`` from row ``first`` on; elsewhere they are 0."""

    first: int
    images: Float

    def add_to(self, images: Float, origin: int = 0) -> None:
        """Add them to radiographs ``(k, views, rows, columns)`` that begin at row ``origin``, where these have rows."""
        at = self.first - origin
        low, high = max(at, 0), min(at + self.images.shape[2], images.shape[2])
        if low < high:
            images[:, :, low:high] += self.images[:, :, low - at : high - at]


Images = tuple[ImageStrip, ...] | StoredImages
"""Strips that add up to k stacks of radiographs, or the stacks in a file."""


def rows_of(patches: PatchTable) -> tuple[int, int]:
    """First row of pixels that patches reach, and the one after the last."""
    return int(patches.boxes[:, 2].min(initial=2**31)), int(patches.boxes[:, 3].max(initial=0))


def below(patches: PatchTable, first: int) -> PatchTable:
    """The same patches, with rows counted from ``first`` on."""
    boxes = patches.boxes.copy()
    boxes[:, 2:4] -= first
    return patches._replace(boxes=boxes)


# ---------------------------------------------------------------------- projections
def project(voxels: Image, rays: Rays) -> Image:
    """Line integrals of all patches, flat."""
    with use_worker_threads():
        return CPU.project(rays.grains._replace(voxels=voxels), rays.fixed_views, rays.patches, rays.exact)


def differentiate(voxels: Image, rays: Rays) -> ProjectedPatches:
    """These and their derivatives."""
    with use_worker_threads():
        grains = rays.grains._replace(voxels=voxels)
        return ProjectedPatches(*CPU.project_with_derivatives(grains, rays.fixed_views, rays.patches, rays.exact))


def values_of(piece: Piece) -> Image:
    """Line integrals."""
    return piece.values if isinstance(piece, ProjectedPatches) else piece


def derivatives_of(piece: Piece) -> Image:
    """Derivatives, not yet filtered or filtered."""
    return piece.derivatives if isinstance(piece, ProjectedPatches) else piece


# ---------------------------------------------------------------------- radiographs
def add_up(piece: Piece, patches: PatchTable, like: tuple[int, int]) -> ImageStrip:
    """Sum of the patches, in radiographs of so many views and columns."""
    first, end = rows_of(patches)
    images = np.zeros((1, like[0], max(end - first, 0), like[1]))
    grain_projection.add_patches(values_of(piece), below(patches, first).boxes, patches.offsets, images[0])
    return ImageStrip(first, images)


def jvp(piece: Piece, patches: PatchTable, increments: Float, like: tuple[int, int]) -> ImageStrip:
    """What increments ``(k, n, 6)`` of the grains change in the radiographs, in double precision."""
    first, end = rows_of(patches)
    views, columns = like
    stacks = np.zeros((len(increments), views, max(end - first, 0), columns))
    tables = below(patches, first).boxes, patches.offsets, patches.order, patches.view_starts
    with use_worker_threads():
        normal_equations.jvp(derivatives_of(piece), *tables, np.ascontiguousarray(increments), stacks)
    return ImageStrip(first, stacks)


def merge(*strips: ImageStrip) -> ImageStrip:
    """Sum of radiographs."""
    filled = [s for s in strips if s.images.size] or [strips[0]]
    first, end = min(s.first for s in filled), max(s.first + s.images.shape[2] for s in filled)
    k, views, _, columns = strips[0].images.shape
    out = np.zeros((k, views, max(end - first, 0), columns))
    for strip in filled:
        strip.add_to(out, first)
    return ImageStrip(first, out)


def _stacks(images: Images, patches: PatchTable, precision: np.dtype[np.floating]) -> tuple[Image, PatchTable]:
    """The rows of k stacks of radiographs that patches reach, and the patches counted from there."""
    first, end = rows_of(patches)
    if isinstance(images, StoredImages):
        return images.rows(first, end), below(patches, first)
    k, views, _, columns = images[0].images.shape
    out = np.empty((k, views, max(end - first, 0), columns), precision)
    for stack in range(k):  # one after the other, while its numbers are in the cache
        total = np.zeros((1, *out.shape[1:]))
        for part in images:
            ImageStrip(part.first, part.images[stack : stack + 1]).add_to(total, first)
        out[stack] = in_precision(total[0], precision)
    return out, below(patches, first)


# ---------------------------------------------------------------------- derivatives
def filtered(piece: Piece, patches: PatchTable, factor: StoredImages, kernel: Image) -> Image:
    """Derivatives times a factor of each pixel, then filtered patch by patch."""
    out = derivatives_of(piece).copy()
    ((images,), here) = _stacks(factor, patches, out.dtype)
    with use_worker_threads():
        CPU.filter_patches(out, here, images, kernel)
    return out


def vjp(piece: Piece, *parts: ImageStrip, patches: PatchTable, images: StoredImages | None = None) -> Float:
    """Dot products ``(k, patches, 6)`` of each patch's derivatives with radiographs, in strips or from a file."""
    derivatives = derivatives_of(piece)
    stacks, here = _stacks(images or parts, patches, derivatives.dtype)
    with use_worker_threads():
        return CPU.vjp(derivatives, here, list(stacks))


def select(piece: Piece, patches: PatchTable, which: Index) -> Image:
    """Derivatives of some of the patches, one after the other."""
    cuts = [slice(a, b) for a, b in zip(patches.offsets[which], patches.offsets[which + 1], strict=True)]
    return np.concatenate([derivatives_of(piece)[:, cut] for cut in cuts], axis=1)


def gram_blocks(piece: Piece, *others: Image, patches: PatchTable, pairs: Index, first: Index) -> Float:
    """6×6 blocks of JᵀJ; ``patches`` are the piece's own, followed by those selected from other pieces."""
    own = derivatives_of(piece)
    together = np.concatenate([own, *others], axis=1) if others else own
    with use_worker_threads():
        return CPU.gram_blocks(together, patches, pairs, first)


def map_grains(
    voxels: Image,
    function: Callable[[object, Pose, tuple[Image, ...], object], Float],
    stored: StoredObject,
    images: StoredImages,
) -> Float:
    """A function of the piece's grains, see `PatchBackend.map_grains`."""
    without_voxels, pose, settings = stored.load()
    with use_worker_threads():
        return function(replace(without_voxels, images=voxels), pose, tuple(images.all()), settings)
