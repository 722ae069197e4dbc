"""Cast: what grains cast on the radiographs at a pose, patch by patch, and what is summed over each of them.

Nothing here needs more than the grains' own voxels and images that all grains share, so it may be done by
blocks of grains, by whom else it may (see `residual.Crew`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from grainmotion.geometry import Geometry
from grainmotion.kernels import normal
from grainmotion.packed import Image, PackedGrains, Pose
from grainmotion.project import Patches, Projector, difference_patches, differentiate_patches, shadows
from grainmotion.tracking.columns import Columns
from grainmotion.tracking.coupling import normal_matrix
from grainmotion.tracking.surroundings import by_angle

Float = NDArray[np.float64]
Derivatives = Literal["analytic", "differences"]


@dataclass(frozen=True, eq=False)
class Walk:
    """How grains are walked: the views, the operator, how derivatives are taken, the filter's reach in pixels."""

    geometry: Geometry
    projector: Projector
    derivatives: Derivatives
    margin: int


class Shown(Protocol):
    """What all grains of a sample cast, wherever it is held; rows and blocks come in the sample's order."""

    def each(self, function: Callable[..., Float], *images: Image) -> Float:
        """``function(cast, *images)``, one row a grain, with images ``(views, rows, columns)`` that all share."""
        ...

    def border(self, columns: Columns) -> Float:
        """JᵀC ``(6n, m)``."""
        ...

    def normal_matrix(self) -> sparse.bsr_array:
        """JᵀJ ``(6n, 6n)``."""
        ...

    def refiltered(self, factor: Image, kernel: Image) -> Shown:
        """The same with derivatives filtered once more, then times ``factor (views, rows, columns)``."""
        ...


@dataclass(frozen=True, eq=False)
class Cast:
    """What some grains cast, held here.

    ``values`` are the grains' own line integrals and ``derivatives (6, pixels)`` those by (u, δ), flat, as
    ``patches`` say.
    """

    grains: PackedGrains
    pose: Pose
    patches: Patches
    values: Image
    derivatives: Image

    @classmethod
    def of(cls, grains: PackedGrains, pose: Pose, walk: Walk) -> Cast:
        """Walk every ray of every grain once; patches have a margin for the filter."""
        patches = shadows(grains, pose, walk.geometry, margin=walk.margin)
        differentiate = differentiate_patches if walk.derivatives == "analytic" else difference_patches
        return cls(grains, pose, patches, *differentiate(grains, pose, walk.geometry, patches, walk.projector))

    def turned(self) -> Image:
        """Derivatives of the line integrals, flat, by the stage's angle."""
        places = (self.grains.centers + self.pose.translations)[self.patches.boxes[:, 0]]
        sizes = np.diff(self.patches.offsets)
        x, y = (np.repeat(places[:, k], sizes).astype(self.derivatives.dtype) for k in (0, 1))
        return by_angle(x, y, self.derivatives)

    def filter(self, factor: Image, kernel: Image) -> None:
        """Weight the derivatives by ``factor (views, rows, columns)`` and filter them, in place."""
        normal.filter_patches(self.derivatives, self.patches.boxes, self.patches.offsets, factor, kernel)

    def each(self, function: Callable[..., Float], *images: Image) -> Float:
        """See `Shown`."""
        return function(self, *images)

    def border(self, columns: Columns) -> Float:
        """See `Shown`."""
        return columns.border(self.derivatives, self.patches, len(self.grains))

    def normal_matrix(self) -> sparse.bsr_array:
        """See `Shown`."""
        return normal_matrix(self.derivatives, self.patches, len(self.grains))

    def refiltered(self, factor: Image, kernel: Image) -> Cast:
        """See `Shown`."""
        again = replace(self, derivatives=self.derivatives.copy())
        again.filter(np.ones_like(factor), kernel)
        again.filter(factor, np.ones(1, kernel.dtype))
        return again


def coverage(cast: Cast) -> Float:
    """Share of each grain's shadow that falls on the panel, mean over views ``(n, 1)``."""
    return cast.patches.seen.mean(axis=1, keepdims=True)


def own_sums(cast: Cast, *images: Image, terms: Callable[..., list[float]], count: int) -> Float:
    """Sums ``(n, count)`` over each grain's own pixels of ``terms(own, *images)``.

    ``own`` are the grain's line integrals, the images those given, in one patch, all flat and double.
    """
    offsets, out = cast.patches.offsets, np.zeros((len(cast.grains), count))
    for p, (grain, view, r0, r1, c0, c1) in enumerate(cast.patches.boxes):
        own = cast.values[offsets[p] : offsets[p + 1]].astype(float)
        out[grain] += terms(own, *(image[view, r0:r1, c0:c1].ravel().astype(float) for image in images))
    return out
