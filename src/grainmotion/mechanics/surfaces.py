"""Surfaces of grains: points with outward normals, precise to a fraction of a voxel.

The surface of a grain is where its own attenuation, filtered by a Gaussian of `SURFACE_SIGMA` voxels, falls to half of
what is typical of the grain.  Between two grains that touch, labels cut it there along the faces of voxels; the filter
takes their steps away.  A filter moves a curved surface inwards, by σ²/R for a sphere of radius R.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree
from skimage.measure import marching_cubes

from grainmotion._typing import Float
from grainmotion.analysis.deformed_volume import typical_attenuation
from grainmotion.model.grains import Grain, GrainSet

SURFACE_SIGMA = 0.7
"""Width of the Gaussian filter under which a surface is found, voxels of the reference."""
MAX_KEPT_SURFACES = 400
"""Surfaces kept in memory at a time, of some 0.3 MB each; others are made again when they are needed."""


@dataclass(frozen=True, eq=False)
class Surface:
    """Surface of one grain in the reference state.

    Attributes
    ----------
    points, normals : (k, 3) arrays
        Points on it, mm, x y z, sample frame, and outward unit normals.
    tree : cKDTree
        Of the points.
    radius : float
        Largest distance of a point from the grain's centre, mm.
    """

    points: Float
    normals: Float
    tree: cKDTree
    radius: float

    def distances(self, points: Float, limit: float) -> tuple[Float, NDArray[np.int64]]:
        """Signed distances of points ``(m, 3)``, mm, positive outside, and the nearest points of the surface.

        The distance is to the tangent plane at the nearest point: wrong in second order of the spacing of points.
        Points farther than ``limit`` have infinite distance.
        """
        apart, nearest = self.tree.query(points, distance_upper_bound=limit)
        found = np.isfinite(apart)
        out, index = np.full(len(points), np.inf), np.where(found, nearest, 0)
        offsets = points[found] - self.points[index[found]]
        out[found] = np.einsum("ij,ij->i", offsets, self.normals[index[found]])
        return out, index


def surface_of(grain: Grain, voxel_size: float) -> Surface | None:
    """The surface of a grain whose reference has this voxel size, mm; None if it has no attenuation above its level."""
    volume = grain.volume if grain.fine is None else grain.fine
    level = typical_attenuation(grain) / 2
    if level <= 0:
        return None
    sigma = SURFACE_SIGMA * voxel_size / volume.voxel_size
    field = ndimage.gaussian_filter(np.pad(volume.array, 2), sigma, mode="constant")
    bodies, count = ndimage.label(field > level)
    if count == 0 or min(volume.shape) < 2:
        return None
    if count > 1:  # specks of noise are no surface of the grain
        largest = 1 + int(np.argmax(np.bincount(bodies.ravel())[1:]))
        field = np.where((bodies == largest) | (bodies == 0), field, 0)
    corners, faces, _, _ = marching_cubes(field, level)
    places = (corners[:, ::-1].astype(float) - 2) * volume.voxel_size + volume.origin
    normals = _normals(places, faces)
    return Surface(places, normals, cKDTree(places), float(np.linalg.norm(places - grain.center, axis=1).max()))


def _normals(places: Float, faces: NDArray[np.integer]) -> Float:
    """Outward unit normals of the corners of a closed mesh, means of the faces around them by area."""
    a, b, c = (places[faces[:, k]] for k in range(3))
    of_faces = np.cross(b - a, c - a)
    middle = places.mean(axis=0)
    if np.einsum("ij,ij->", a - middle, of_faces) < 0:
        of_faces = -of_faces
    normals = np.zeros_like(places)
    for corner in range(3):
        np.add.at(normals, faces[:, corner], of_faces)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return normals / np.where(lengths > 0, lengths, 1.0)


class SurfaceCache:
    """Surfaces of the grains of a set, made when they are needed; the last `MAX_KEPT_SURFACES` are kept."""

    def __init__(self, grains: GrainSet) -> None:
        self._grains = grains
        self._kept: OrderedDict[int, Surface | None] = OrderedDict()

    def __getitem__(self, row: int) -> Surface | None:
        """The surface of the grain in this row of the set."""
        if row not in self._kept:
            self._kept[row] = surface_of(self._grains.grains[row], self._grains.voxel_size)
            if len(self._kept) > MAX_KEPT_SURFACES:
                self._kept.popitem(last=False)
        self._kept.move_to_end(row)
        return self._kept[row]
