"""What workers do of a state: plain functions over pieces of the sample, some grains each, that know no Dask.

Boxes and offsets are those of `grains.Patches`, of a piece's own patches; grains count within the piece.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from grainmotion._typing import Float, Image, Index
from grainmotion.cluster.shared_store import StoredImages, StoredObject
from grainmotion.cluster.worker_threads import own_threads
from grainmotion.kernels import grain_projection, normal_equations


@dataclass(frozen=True, eq=False)
class PatchTable:
    """Patches of some grains."""

    boxes: Index
    offsets: Index

    @property
    def rows(self) -> tuple[int, int]:
        """First row of pixels that they touch, and the one after the last."""
        return int(self.boxes[:, 2].min(initial=2**31)), int(self.boxes[:, 3].max(initial=0))

    def below(self, first: int) -> PatchTable:
        """The same, rows counted from ``first`` on."""
        boxes = self.boxes.copy()
        boxes[:, 2:4] -= first
        return replace(self, boxes=boxes)


@dataclass(frozen=True, eq=False)
class Rays:
    """Grains and the rays to trace through them: arguments of `kernels.grain_projection.project` beside the patches."""

    grains: tuple[Index, Index, Float, Image, float, Float, Float]
    views: tuple[Float, bool, Index]
    jobs: Index
    exact: bool


@dataclass(frozen=True, eq=False)
class ProjectedPatches:
    """Line integrals of all patches, flat, and their derivatives ``(6, pixels)``."""

    values: Image
    derivatives: Image


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
"""Parts that add up to radiographs, or k stacks of them, one above the other."""


# ---------------------------------------------------------------------- walks
def project(voxels: Image, rays: Rays, some: PatchTable) -> Image:
    """Line integrals of all patches, flat."""
    values = np.zeros(some.offsets[-1], voxels.dtype)
    with own_threads():
        grain_projection.project(
            voxels, *rays.grains, *rays.views, some.boxes, some.offsets, rays.jobs, rays.exact, values
        )
    return values


def differentiate(voxels: Image, rays: Rays, some: PatchTable) -> ProjectedPatches:
    """These and their derivatives."""
    values, derivatives = (np.zeros((*k, some.offsets[-1]), voxels.dtype) for k in ((), (6,)))
    with own_threads():
        grain_projection.project_with_derivatives(
            voxels, *rays.grains, *rays.views, some.boxes, some.offsets, rays.jobs, rays.exact, values, derivatives
        )
    return ProjectedPatches(values, derivatives)


def values_of(piece: Image | ProjectedPatches) -> Image:
    """Line integrals."""
    return piece.values if isinstance(piece, ProjectedPatches) else piece


def derivatives_of(piece: Image | ProjectedPatches) -> Image:
    """Derivatives, not yet filtered or filtered."""
    return piece.derivatives if isinstance(piece, ProjectedPatches) else piece


# ---------------------------------------------------------------------- radiographs
def add_up(piece: Image | ProjectedPatches, some: PatchTable, like: tuple[int, int]) -> ImageStrip:
    """Sum of the patches, in radiographs of so many views and columns."""
    first, end = some.rows
    images = np.zeros((1, like[0], max(end - first, 0), like[1]))
    grain_projection.add_patches(values_of(piece), some.below(first).boxes, some.offsets, images[0])
    return ImageStrip(first, images)


def spread(piece: Image | ProjectedPatches, some: PatchTable, increments: Float, like: tuple[int, int]) -> ImageStrip:
    """What increments ``(k, n, 6)`` of the grains change in the radiographs."""
    first, end = some.rows
    views, columns = like
    images = np.zeros((len(increments), views, max(end - first, 0), columns))
    order = np.argsort(some.boxes[:, 1], kind="stable")
    starts, boxes = np.searchsorted(some.boxes[order, 1], np.arange(views + 1)), some.below(first).boxes
    with own_threads():
        for each, found in zip(increments, images, strict=True):
            normal_equations.spread(derivatives_of(piece), boxes, some.offsets, order, starts, each, found)
    return ImageStrip(first, images)


def merge(*stripes: ImageStrip) -> ImageStrip:
    """Sum of radiographs."""
    filled = [s for s in stripes if s.images.size] or [stripes[0]]
    first, end = min(s.first for s in filled), max(s.first + s.images.shape[2] for s in filled)
    k, views, _, columns = stripes[0].images.shape
    out = np.zeros((k, views, max(end - first, 0), columns))
    for stripe in filled:
        stripe.add_to(out, first)
    return ImageStrip(first, out)


def _stacks(images: Images, some: PatchTable, precision: np.dtype[np.floating]) -> tuple[Image, PatchTable]:
    """The rows of k stacks of radiographs that patches touch, and the patches counted from there."""
    first, end = some.rows
    if isinstance(images, StoredImages):
        return images.rows(first, end), some.below(first)
    k, views, _, columns = images[0].images.shape
    out = np.empty((k, views, max(end - first, 0), columns), precision)
    for stack in range(k):  # one after the other, while its numbers are at hand
        total = np.zeros((1, *out.shape[1:]))
        for part in images:
            ImageStrip(part.first, part.images[stack : stack + 1]).add_to(total, first)
        out[stack] = total[0]
    return out, some.below(first)


# ---------------------------------------------------------------------- derivatives
def filtered(piece: Image | ProjectedPatches, some: PatchTable, factor: StoredImages, kernel: Image) -> Image:
    """Derivatives times a factor of each pixel, then filtered patch by patch."""
    out = derivatives_of(piece).copy()
    ((images,), here) = _stacks(factor, some, out.dtype)
    with own_threads():
        normal_equations.filter_patches(out, here.boxes, here.offsets, images, kernel)
    return out


def gradients(
    piece: Image | ProjectedPatches, *parts: ImageStrip, some: PatchTable, images: StoredImages | None = None
) -> Float:
    """Dot products ``(k, patches, 6)`` of each patch's derivatives with radiographs, in parts or from the shelf."""
    derivatives = derivatives_of(piece)
    stacks, here = _stacks(images or parts, some, derivatives.dtype)
    out = np.zeros((len(stacks), len(some.boxes), 6))
    with own_threads():
        for stack, found in zip(stacks, out, strict=True):
            normal_equations.gradients(derivatives, here.boxes, here.offsets, stack, found)
    return out


def lend(piece: Image | ProjectedPatches, some: PatchTable, patches: Index) -> Image:
    """Derivatives of some of the patches, one after the other."""
    cuts = [slice(a, b) for a, b in zip(some.offsets[patches], some.offsets[patches + 1], strict=True)]
    return np.concatenate([derivatives_of(piece)[:, cut] for cut in cuts], axis=1)


def blocks(piece: Image | ProjectedPatches, *loans: Image, some: PatchTable, pairs: Index, first: Index) -> Float:
    """6×6 blocks of JᵀJ; ``some`` are the piece's own patches and the borrowed ones after them."""
    out, own = np.zeros((len(first) - 1, 6, 6)), derivatives_of(piece)
    together = np.concatenate([own, *loans], axis=1) if loans else own
    with own_threads():
        normal_equations.blocks(together, some.boxes, some.offsets, pairs, first, out)
    return out


def for_grains(voxels: Image, function: Callable[..., Any], told: StoredObject, images: StoredImages) -> Any:
    """A function of the piece's grains, see `Device.for_grains`."""
    without, pose, how = told.take()
    with own_threads():
        return function(replace(without, images=voxels), pose, *images.all(), how)
