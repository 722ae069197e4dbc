"""A scan on a grid as the equations A x = b, and one update of x by some of their views.

    x ← x + λ / Σᵢ Cᵢ · Σᵢ Aᵢᵀ [(bᵢ − Aᵢ x)/(Aᵢ 1)],   i over some views

with C the column sums of Aᵢ, which are h³ over the area of a pixel carried back to the sample (Andersen and
Kak 1984; Khalili et al. 2017, §2.3).  One view a time is SART, several are an ordered subset.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from grainmotion.geometry import Geometry
from grainmotion.grains import PADDING
from grainmotion.kernels import sart
from grainmotion.operators import VolumeOperator, padded_origin
from grainmotion.packed import Image
from grainmotion.reconstructing.settings import ReconstructSettings
from grainmotion.scan import Scan
from grainmotion.volume import Volume

Views = NDArray[np.int64]
Float = NDArray[np.float64]

NO_LIMIT = np.float32(np.finfo(np.float32).min)


@dataclass(frozen=True, eq=False)
class Equations:
    """A scan on a grid, in single precision; volumes are laid as `operator` lays them."""

    scan: Scan
    grid: Volume
    settings: ReconstructSettings

    @cached_property
    def operator(self) -> VolumeOperator:
        """A."""
        grid = Volume(self.grid.array.astype(np.float32, copy=False), self.grid.voxel_size, self.grid.center)
        return VolumeOperator(self.scan.geometry, grid, self.settings.projector, self.radius)

    @property
    def radius(self) -> float:
        """Radius of the grid's inscribed upright cylinder, voxels; 0 for none."""
        return min(self.grid.shape[1:]) / 2 if self.settings.circular else 0.0

    @property
    def lowest(self) -> np.float32:
        """The least attenuation that is allowed."""
        return np.float32(0) if self.settings.non_negative else NO_LIMIT

    @cached_property
    def column_sums(self) -> Float:
        """C of each view."""
        return column_sums(self.scan.geometry, self.grid)

    def start(self) -> Image:
        """The grid's own values, laid."""
        return self.operator.laid(self.operator.grid.array)

    def add_update(self, image: Image, views: Views, relaxation: float) -> Float:
        """Update an image by some views in place, without constraints; Σ(b − A x)² and Σb² before it, ``(2,)``."""
        corrections, squares = self.residual(image, views)
        corrections *= np.float32(relaxation / self.column_sums[views].sum())
        self.operator.add_adjoint(corrections, image, views)
        return squares

    def residual(self, image: Image, views: Views) -> tuple[Image, Float]:
        """(b − A x)/(A 1) of some views ``(views, rows, columns)``; Σ(b − A x)² and Σb²."""
        images = self.operator.forward(image, views)
        squares = np.empty((len(views) * images.shape[1], 2))
        valid = np.ones(images.shape, np.bool_) if self.scan.valid is None else self.scan.valid[views]
        sart.compare(
            images, self.scan.line_integrals[views].astype(np.float32, copy=False), valid, padded_origin(self.grid),
            self.grid.voxel_size, tuple(n + 2 * PADDING for n in self.grid.shape), self.radius,
            self.scan.geometry.vectors[views], self.scan.geometry.beam == "cone", squares,
        )  # fmt: skip
        return images, squares.sum(axis=0)

    def constrain(self, image: Image) -> None:
        """Clip an image at zero, inside its cylinder, in place (see the settings)."""
        sart.constrain(self.operator.by_height(image), PADDING, self.radius, self.lowest)

    def constrain_and_extrapolate(self, image: Image, before: Image, momentum: float) -> None:
        """Constrain an image x, leave x in ``before`` and x + momentum · (x − before) in ``image``."""
        sart.constrain_and_extrapolate(
            self.operator.by_height(image), self.operator.by_height(before), PADDING, self.radius, self.lowest,
            np.float32(momentum),
        )  # fmt: skip

    def volume(self, image: Image) -> Volume:
        """A laid image on the grid."""
        return Volume(self.operator.unlaid(image), self.grid.voxel_size, self.grid.center)


def column_sums(geometry: Geometry, grid: Volume) -> Float:
    """Column sums of each view at the grid's centre: h³ over the area of a pixel seen along the ray there."""
    s, d, u, v = (geometry.vectors[:, i : i + 3] for i in (0, 3, 6, 9))
    normal = np.cross(u, v)
    if geometry.beam == "cone":
        ray = np.array(grid.center) - s
        shrink = (ray * normal).sum(1) / ((d - s) * normal).sum(1)
    else:
        ray, shrink = s, np.ones(len(s))
    area = np.abs((ray * normal).sum(1)) / np.linalg.norm(ray, axis=1) * shrink**2
    return grid.voxel_size**3 / area


def golden_order(views: int) -> Views:
    """Views 0 … n − 1 in golden-ratio order: each next one far from those just used."""
    fractions = (np.arange(views) * (np.sqrt(5) - 1) / 2) % 1.0
    return np.argsort(np.argsort(fractions)).astype(np.int64)


def relative(squares: Float) -> float:
    """ε = ‖b − A x‖/‖b‖ (Eq. 23) from the two sums of squares."""
    return float(np.sqrt(squares[0] / squares[1])) if squares[1] > 0 else 0.0
