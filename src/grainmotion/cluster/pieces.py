"""What workers do of a state: plain functions over pieces of the sample, some grains each, that know no Dask.

Boxes and offsets are those of `project.Patches`, of a piece's own patches; grains count within the piece.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from grainmotion.cluster.shelf import ShelvedImages
from grainmotion.cluster.threads import own_threads
from grainmotion.kernels import grains, normal
from grainmotion.packed import Image

Index = NDArray[np.int64]
Float = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Some:
    """Patches of some grains."""

    boxes: Index
    offsets: Index

    @property
    def rows(self) -> tuple[int, int]:
        """First row of pixels that they touch, and the one after the last."""
        return int(self.boxes[:, 2].min(initial=2**31)), int(self.boxes[:, 3].max(initial=0))

    def below(self, first: int) -> Some:
        """The same, rows counted from ``first`` on."""
        boxes = self.boxes.copy()
        boxes[:, 2:4] -= first
        return replace(self, boxes=boxes)


@dataclass(frozen=True, eq=False)
class Rays:
    """Grains and the rays to walk through them, as `kernels.grains.project` takes them, around the patches."""

    grains: tuple[Index, Index, Float, Image, float, Float, Float]
    views: tuple[Float, bool, Index]
    jobs: Index
    exact: bool


@dataclass(frozen=True, eq=False)
class Stripe:
    """Radiographs ``(views, rows, columns)`` from row ``first`` on; elsewhere they are 0."""

    first: int
    images: Image

    def add_to(self, images: Image, origin: int = 0) -> None:
        """Add them to radiographs that begin at row ``origin``."""
        at = self.first - origin
        images[:, at : at + self.images.shape[1]] += self.images


Shape = tuple[int, int, np.dtype[np.floating]]
"""Views and columns of radiographs, and their precision."""
Images = Stripe | ShelvedImages


# ---------------------------------------------------------------------- walks
def project(voxels: Image, rays: Rays, some: Some) -> Image:
    """Line integrals of all patches, flat."""
    values = np.zeros(some.offsets[-1], voxels.dtype)
    with own_threads():
        grains.project(voxels, *rays.grains, *rays.views, some.boxes, some.offsets, rays.jobs, rays.exact, values)
    return values


def differentiate(voxels: Image, rays: Rays, some: Some) -> tuple[Image, Image]:
    """These and their derivatives ``(6, pixels)``."""
    values, derivatives = (np.zeros((*k, some.offsets[-1]), voxels.dtype) for k in ((), (6,)))
    with own_threads():
        grains.project_with_derivatives(
            voxels, *rays.grains, *rays.views, some.boxes, some.offsets, rays.jobs, rays.exact, values, derivatives
        )
    return values, derivatives


def first_of(pair: tuple[Image, Image]) -> Image:
    """Line integrals."""
    return pair[0]


def second_of(pair: tuple[Image, Image]) -> Image:
    """Derivatives."""
    return pair[1]


# ---------------------------------------------------------------------- radiographs
def add_up(values: Image, some: Some, like: Shape) -> Stripe:
    """Sum of the patches."""
    first, end = some.rows
    views, columns, precision = like
    images = np.zeros((views, max(end - first, 0), columns), precision)
    grains.add_patches(values, some.below(first).boxes, some.offsets, images)
    return Stripe(first, images)


def spread(derivatives: Image, some: Some, increments: Float, like: Shape) -> Stripe:
    """What increments ``(n, 6)`` of the grains change in the radiographs."""
    first, end = some.rows
    views, columns, precision = like
    images = np.zeros((views, max(end - first, 0), columns), precision)
    order = np.argsort(some.boxes[:, 1], kind="stable")
    starts = np.searchsorted(some.boxes[order, 1], np.arange(views + 1))
    with own_threads():
        normal.spread(derivatives, some.below(first).boxes, some.offsets, order, starts, increments, images)
    return Stripe(first, images)


def merge(*stripes: Stripe) -> Stripe:
    """Sum of radiographs."""
    filled = [s for s in stripes if s.images.size] or [stripes[0]]
    first, end = min(s.first for s in filled), max(s.first + s.images.shape[1] for s in filled)
    views, _, columns = stripes[0].images.shape
    out = np.zeros((views, max(end - first, 0), columns), stripes[0].images.dtype)
    for stripe in filled:
        stripe.add_to(out, first)
    return Stripe(first, out)


def _rows(images: Images, some: Some) -> tuple[Image, Some]:
    """The rows of radiographs that patches touch, and the patches counted from there."""
    first, end = some.rows
    if isinstance(images, ShelvedImages):
        return images.rows(first, end), some.below(first)
    return images.images, some.below(images.first)


# ---------------------------------------------------------------------- derivatives
def filtered(derivatives: Image, some: Some, factor: ShelvedImages, kernel: Image) -> Image:
    """Derivatives times a factor of each pixel, then filtered patch by patch."""
    out = derivatives.copy()
    images, here = _rows(factor, some)
    with own_threads():
        normal.filter_patches(out, here.boxes, here.offsets, images, kernel)
    return out


def gradients(derivatives: Image, images: Images, some: Some) -> Float:
    """Dot products of each patch's derivatives with radiographs, ``(patches, 6)``."""
    part, here = _rows(images, some)
    out = np.zeros((len(some.boxes), 6))
    with own_threads():
        normal.gradients(derivatives, here.boxes, here.offsets, part, out)
    return out


def gradients_of_shelved(derivatives: Image, some: Some, images: ShelvedImages) -> Float:
    """The same with radiographs from the shelf."""
    return gradients(derivatives, images, some)


def lend(derivatives: Image, some: Some, patches: Index) -> Image:
    """Derivatives of some of the patches, one after the other."""
    cuts = [slice(a, b) for a, b in zip(some.offsets[patches], some.offsets[patches + 1], strict=True)]
    return np.concatenate([derivatives[:, cut] for cut in cuts], axis=1)


def blocks(derivatives: Image, *loans: Image, some: Some, pairs: Index, first: Index) -> Float:
    """6×6 blocks of JᵀJ; ``some`` are the piece's own patches and the borrowed ones after them."""
    out = np.zeros((len(first) - 1, 6, 6))
    together = np.concatenate([derivatives, *loans], axis=1) if loans else derivatives
    with own_threads():
        normal.blocks(together, some.boxes, some.offsets, pairs, first, out)
    return out
