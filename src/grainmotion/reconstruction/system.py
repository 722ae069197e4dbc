"""The equations A x = b of a scan on a grid, and updates of x by some of its views.

    x ← x + λ / Σᵢ Cᵢ · Σᵢ Aᵢᵀ [(bᵢ − Aᵢ x)/(Aᵢ 1)],   i over some views

with C the column sums of Aᵢ, which are h³ over the area of a pixel carried back to the sample (Andersen and
Kak 1984; Khalili et al. 2017, §2.3).  One view a time is SART, several are an ordered subset.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float, Image
from grainmotion.kernels import sart
from grainmotion.kernels.layout import PADDING
from grainmotion.model.geometry import Geometry
from grainmotion.model.volume import Volume
from grainmotion.projection.volume_operator import VolumeOperator, padded_origin
from grainmotion.reconstruction.settings import ReconstructSettings

Views = NDArray[np.int64]

SumOfSquares = Any
"""Σ(b − A x)² and Σb²: an array ``(2,)``, or one that is still being computed on a GPU or by workers.

Such sums can be added up before they are known, and are waited for when they are read (on a GPU) or added (of workers).
"""


class Iterate(Protocol):
    """A volume during its reconstruction, in this process, on a GPU or on workers."""

    ahead: int
    """Updates to request before the sums of the first are needed, so that workers never wait."""

    def update(self, views: Views, relaxation: float, momentum: float = 0.0) -> SumOfSquares:
        """Update the volume by some views, and constrain it: zero beyond its cylinder, not negative (see the settings).

        With momentum it continues from the constrained volume x at x + momentum · (x − the x of the previous update).
        Returns Σ(b − A x)² and Σb² before the update, ``(2,)``.
        """
        ...

    def volume(self) -> Volume:
        """The volume as it was last constrained, on its grid."""
        ...

    def into_volume(self) -> Volume:
        """As `volume`, at the end of the iteration: its own arrays are freed meanwhile, as both may not fit."""
        ...


@dataclass(frozen=True, eq=False)
class Frame:
    """Region in which rays count: ``size`` (nz, ny, nx) and ``origin`` of the padded volume, and its cylinder."""

    size: tuple[int, ...]
    origin: Float
    voxel_size: float
    radius: float

    @classmethod
    def of(cls, grid: Volume, settings: ReconstructSettings) -> Frame:
        """The region of a grid."""
        size, radius = tuple(n + 2 * PADDING for n in grid.shape), cylinder_radius(grid, settings)
        return cls(size, padded_origin(grid), grid.voxel_size, radius)


@dataclass(frozen=True, eq=False)
class Imaging:
    """Projection of a grid on views, in single precision; volumes are in the padded layout of `operator`."""

    geometry: Geometry
    grid: Volume
    settings: ReconstructSettings

    @cached_property
    def operator(self) -> VolumeOperator:
        """A."""
        grid = Volume(self.grid.array.astype(np.float32, copy=False), self.grid.voxel_size, self.grid.center)
        return VolumeOperator(self.geometry, grid, self.settings.projector, self.radius)

    @property
    def radius(self) -> float:
        """Radius of the grid's inscribed upright cylinder, voxels; 0 for none."""
        return cylinder_radius(self.grid, self.settings)

    def constrain(self, image: Image) -> None:
        """Clip an image at zero, inside its cylinder, in place (see the settings)."""
        sart.constrain(self.operator.by_height(image), PADDING, self.radius, lower_limit(self.settings))

    def constrain_and_extrapolate(self, image: Image, before: Image, momentum: float) -> None:
        """Constrain an image x, leave x in ``before`` and x + momentum · (x − before) in ``image``."""
        sart.constrain_and_extrapolate(
            self.operator.by_height(image), self.operator.by_height(before), PADDING, self.radius,
            lower_limit(self.settings), np.float32(momentum),
        )  # fmt: skip


def cylinder_radius(grid: Volume, settings: ReconstructSettings) -> float:
    """Radius of the upright cylinder beyond which the volume is zero, voxels; 0 for none.

    It is the grid's inscribed one, or the sample's outline if that is known and smaller.
    """
    if not settings.circular:
        return 0.0
    inscribed = min(grid.shape[1:]) / 2
    return inscribed if isinstance(settings.outline, str) else min(inscribed, settings.outline / grid.voxel_size)


def lower_limit(settings: ReconstructSettings) -> np.float32:
    """The least attenuation that is allowed."""
    return np.float32(0 if settings.non_negative else np.finfo(np.float32).min)


def column_sums(geometry: Geometry, grid: Volume) -> Float:
    """Column sums of each view at the grid's centre: h³ over the cross-section of a pixel there."""
    normals = geometry.normals
    if geometry.beam == "cone":
        ray = np.array(grid.center) - geometry.source
        shrink = (ray * normals).sum(1) / (geometry.rays * normals).sum(1)
    else:
        ray, shrink = geometry.rays, np.ones(len(geometry))
    area = np.abs((ray * normals).sum(1)) / np.linalg.norm(ray, axis=1) * shrink**2
    return grid.voxel_size**3 / area


def golden_order(views: int) -> Views:
    """Views 0 … n − 1 in golden-ratio order: each next one far from those just used."""
    fractions = (np.arange(views) * (np.sqrt(5) - 1) / 2) % 1.0
    return np.argsort(np.argsort(fractions)).astype(np.int64)


def relative(squares: SumOfSquares) -> float:
    """ε = ‖b − A x‖/‖b‖ (Eq. 23) from the two sums of squares."""
    return float(np.sqrt(squares[0] / squares[1])) if squares[1] > 0 else 0.0
