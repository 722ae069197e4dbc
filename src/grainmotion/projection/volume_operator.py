"""VolumeOperator: the line integrals A x of a whole volume and the adjoint Aᵀ y, block of views by block of views.

Two projectors compute the same sums.  `kernels.volume_projection_vertical` serves panels whose columns are parallel to
the rotation axis and keeps the volume with z fastest; `kernels.volume_projection` serves any view, more slowly.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numba
import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float, Image, Projector
from grainmotion.errors import InputError
from grainmotion.kernels import volume_projection, volume_projection_vertical
from grainmotion.kernels.layout import PADDING
from grainmotion.model.geometry import Geometry
from grainmotion.model.large_arrays import large_zeros
from grainmotion.model.progress import counted
from grainmotion.model.slabs import slabs
from grainmotion.model.volume import Volume

SAMPLES_OF_A_CALL, UPRIGHT_SAMPLES_OF_A_CALL = 1e9, 3e9
"""Samples of the volume that a call of a kernel takes at most, unless one view needs more: about a second."""
MIN_ROW_DISTANCE, MAX_ROW_DISTANCE = 0.1, 4.0
"""Distances of neighbouring rays, voxels, between which their voxels are taken together (`vertical_trilinear`)."""
MAX_RAY_SLOPE = 1.0
"""Rise of a ray per length along its horizontal axis, up to which that axis is the dominant one."""


@dataclass(frozen=True, eq=False)
class VolumeOperator:
    """A volume's projection to some views as a linear operator.

    Attributes
    ----------
    geometry : Geometry
        Views to project to.
    grid : Volume
        Where the voxels are; its values are not used, its precision is.
    projector : {"trilinear", "exact"}
        The smooth image, sampled once a voxel, or the exact path through box-shaped voxels.
    radius : float
        Radius of the upright cylinder around the grid's middle beyond which the volume is zero, voxels; 0 for none.
    """

    geometry: Geometry
    grid: Volume
    projector: Projector = "trilinear"
    radius: float = 0.0

    @cached_property
    def upright(self) -> bool:
        """Whether the projector for upright detectors serves.

        That is for columns along z, no ray steeper than 45°, and neighbouring rays a voxel or so apart.
        """
        d, u, v = self.geometry.detector, self.geometry.u, self.geometry.v
        if np.abs(v[:, :2]).max() > 1e-9 * np.abs(v[:, 2]).min():
            return False
        least, most = self._row_distances
        if least < MIN_ROW_DISTANCE or most > MAX_ROW_DISTANCE:
            return False
        rows, columns = self.geometry.shape
        across, along = (columns - 1) / 2 * np.array([-1, 0, 1]), (rows - 1) / 2 * np.array([-1, 1])
        rays = self.geometry.source[:, None, None]
        if self.geometry.beam == "cone":
            rays = (
                d[:, None, None] + across[:, None, None] * u[:, None, None] + along[:, None] * v[:, None, None] - rays
            )
        return bool(np.all(np.abs(rays[..., 2]) <= MAX_RAY_SLOPE * np.abs(rays[..., :2]).max(axis=-1)))

    @property
    def _row_distances(self) -> tuple[float, float]:
        """The least and the largest distance along z of the rays of neighbouring rows inside the volume, voxels."""
        rows = np.abs(self.geometry.v[:, 2]) / self.grid.voxel_size
        if self.geometry.beam != "cone":
            return float(rows.min()), float(rows.max())
        _, ny, nx = self.grid.shape
        reach = (self.radius if self.radius > 0 else np.hypot(nx, ny) / 2 + PADDING) + PADDING
        source, normals = self.geometry.source, self.geometry.normals
        normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        panel = ((self.geometry.detector - source) * normals).sum(1)
        center = ((np.array(self.grid.center) - source) * normals).sum(1)
        beside = np.sign(panel) * reach * self.grid.voxel_size
        least, most = (center - beside) / panel * rows, (center + beside) / panel * rows
        return float(least.min()), float(most.max())

    # ------------------------------------------------------------------ layout of the volume
    def padded(self, array: Image) -> Image:
        """A volume's ``[z, y, x]`` values with empty layers around, in the axis order of the projector (a copy)."""
        image, inner = self.empty(), slice(PADDING, -PADDING)
        values, given = self.by_height(image)[inner, inner, inner], array.transpose(1, 2, 0)
        for rows, _ in slabs(len(values)):
            values[rows] = given[rows]
        return image

    def unpadded(self, image: Image) -> Image:
        """The ``[z, y, x]`` values of a padded volume."""
        inner = slice(PADDING, -PADDING)
        array = image.transpose(2, 0, 1) if self.upright else image
        return np.ascontiguousarray(array[inner, inner, inner])

    def by_height(self, image: Image) -> Image:
        """A padded volume seen as ``[y, x, z]``, without a copy."""
        return image if self.upright else image.transpose(1, 2, 0)

    def empty(self) -> Image:
        """A padded volume of zeros."""
        nz, ny, nx = (n + 2 * PADDING for n in self.grid.shape)
        _check_size((nz, ny, nx), self.grid.shape)
        return large_zeros((ny, nx, nz) if self.upright else (nz, ny, nx), self.grid.array.dtype)

    # ------------------------------------------------------------------ A and Aᵀ
    def forward(self, image: Image, views: NDArray[np.int64] | None = None) -> Image:
        """A x of some views (default all) from a padded volume: line integrals ``(views, rows, columns)``."""
        vectors = self._vectors(views)
        out = np.empty((len(vectors), *self.geometry.shape), image.dtype)
        origin, h, cone = self._origin, self.grid.voxel_size, self.geometry.beam == "cone"
        exact, threads = self.projector == "exact", numba.get_num_threads()
        for part in self._parts(len(vectors)):
            if self.upright:
                where = origin, h, vectors[part], cone, exact, self.radius, threads
                volume_projection_vertical.forward(image, *where, out[part])
            else:
                volume_projection.forward(image, origin, h, vectors[part], cone, exact, out[part])
        return out

    def add_adjoint(self, images: Image, out: Image, views: NDArray[np.int64] | None = None) -> None:
        """Add Aᵀ y of some views (default all) to a padded volume; its outermost layers are undefined then."""
        vectors = self._vectors(views)
        images = np.ascontiguousarray(images, out.dtype)
        origin, h, cone = self._origin, self.grid.voxel_size, self.geometry.beam == "cone"
        exact, threads = self.projector == "exact", numba.get_num_threads()
        for part in self._parts(len(vectors)):
            if self.upright:
                where = origin, h, vectors[part], cone, exact, self.radius, threads
                volume_projection_vertical.adjoint(images[part], *where, out)
            else:
                volume_projection.adjoint(images[part], origin, h, vectors[part], cone, exact, out)

    def _parts(self, views: int) -> Iterator[slice]:
        """Views that one call of a kernel takes: Python looks at signals, and reports progress, between two of them."""
        samples = float(np.prod(self.geometry.shape)) * max(self.grid.shape[1:])
        count = max(1, int((UPRIGHT_SAMPLES_OF_A_CALL if self.upright else SAMPLES_OF_A_CALL) / samples))
        return counted([slice(first, first + count) for first in range(0, views, count)])

    @cached_property
    def _origin(self) -> Float:
        return padded_origin(self.grid)

    def _vectors(self, views: NDArray[np.int64] | None) -> Float:
        vectors = self.geometry.vectors if views is None else self.geometry.vectors[views]
        vectors = np.ascontiguousarray(vectors)
        vectors.setflags(write=False)  # of some views as of all: the kernel is compiled once for both
        return vectors


def pad(array: Image) -> Image:
    """The array with the empty layers that the kernels ask for."""
    _check_size(tuple(n + 2 * PADDING for n in array.shape), array.shape)
    return np.pad(array, PADDING)


def _check_size(padded: tuple[int, ...], shape: tuple[int, ...]) -> None:
    """Refuse what the kernels, which count voxels in 32 bits, cannot hold."""
    if np.prod(padded, dtype=float) >= 2**32:
        raise InputError("volume", f"{shape} voxels are more than 2^32", "reconstruct in parts or coarser")


def padded_origin(volume: Volume) -> Float:
    """Position of voxel [0, 0, 0] of the padded array, mm, x y z."""
    return volume.origin - PADDING * volume.voxel_size
