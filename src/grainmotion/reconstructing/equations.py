"""A scan on a grid as the equations A x = b, and one update of x by some of their views.

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


class Iterate(Protocol):
    """An image under way, wherever it is held."""

    def add_update(self, views: Views, relaxation: float) -> Any:
        """Update it by some views, without constraints; Σ(b − A x)² and Σb² before it, ``(2,)``.

        They may be known later only (`cardoperator.Later`), but can be added up at once.
        """
        ...

    def constrain(self) -> None:
        """Clip it at zero, inside its cylinder (see the settings)."""
        ...

    def constrain_and_extrapolate(self, momentum: float) -> None:
        """Constrain it, x, then go on: x + momentum · (x − the x of the time before)."""
        ...

    def volume(self) -> Volume:
        """It as it was last constrained, on its grid."""
        ...


@dataclass(frozen=True, eq=False)
class Frame:
    """Where rays count: the padded image's ``size`` (nz, ny, nx) and ``origin``, and the cylinder (see `Imaging`)."""

    size: tuple[int, ...]
    origin: Float
    voxel_size: float
    radius: float

    @classmethod
    def of(cls, grid: Volume, settings: ReconstructSettings) -> Frame:
        """That of a whole grid."""
        radius = min(grid.shape[1:]) / 2 if settings.circular else 0.0
        return cls(tuple(n + 2 * PADDING for n in grid.shape), padded_origin(grid), grid.voxel_size, radius)

    def compare(self, images: Image, scan: Scan) -> Float:
        """(b − A x)/(A 1) in place of A x in ``images (views, rows, columns)``; Σ(b − A x)² and Σb²."""
        squares = np.empty((len(scan) * images.shape[1], 2))
        valid = np.ones(images.shape, np.bool_) if scan.valid is None else scan.valid
        sart.compare(
            images, scan.line_integrals.astype(np.float32, copy=False), valid, self.origin, self.voxel_size, self.size,
            self.radius, scan.geometry.vectors, scan.geometry.beam == "cone", squares,
        )  # fmt: skip
        return squares.sum(axis=0)


@dataclass(frozen=True, eq=False)
class Imaging:
    """Views of a grid, in single precision; volumes are laid as `operator` lays them."""

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
        return Frame.of(self.grid, self.settings).radius

    @property
    def lowest(self) -> np.float32:
        """The least attenuation that is allowed."""
        return np.float32(0) if self.settings.non_negative else NO_LIMIT

    @cached_property
    def column_sums(self) -> Float:
        """C of each view."""
        return column_sums(self.geometry, self.grid)

    def start(self) -> Image:
        """The grid's own values, laid."""
        return self.operator.laid(self.operator.grid.array)

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


@dataclass(frozen=True, eq=False)
class Equations:
    """A scan on a grid, in single precision; volumes are laid as `operator` lays them."""

    scan: Scan
    grid: Volume
    settings: ReconstructSettings

    @cached_property
    def imaging(self) -> Imaging:
        """How the grid is seen."""
        return Imaging(self.scan.geometry, self.grid, self.settings)

    @property
    def operator(self) -> VolumeOperator:
        """A."""
        return self.imaging.operator

    def start(self) -> Image:
        """The grid's own values, laid."""
        return self.imaging.start()

    def add_update(self, image: Image, views: Views, relaxation: float) -> Float:
        """Update an image by some views in place, without constraints; Σ(b − A x)² and Σb² before it, ``(2,)``."""
        corrections = self.operator.forward(image, views)
        squares = Frame.of(self.grid, self.settings).compare(corrections, self.scan.select(views))
        corrections *= np.float32(relaxation / self.imaging.column_sums[views].sum())
        self.operator.add_adjoint(corrections, image, views)
        return squares

    def constrain(self, image: Image) -> None:
        """See `Imaging`."""
        self.imaging.constrain(image)

    def constrain_and_extrapolate(self, image: Image, before: Image, momentum: float) -> None:
        """See `Imaging`."""
        self.imaging.constrain_and_extrapolate(image, before, momentum)

    def volume(self, image: Image) -> Volume:
        """A laid image on the grid."""
        return self.imaging.volume(image)


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
