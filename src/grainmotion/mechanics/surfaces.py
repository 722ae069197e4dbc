"""Surfaces of grains: points with outward normals, precise to a fraction of a voxel (see `analysis.grain_mesh`)."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from grainmotion._typing import Float
from grainmotion.analysis.grain_mesh import grain_mesh
from grainmotion.model.grains import Grain, GrainSet

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


def is_slice(grains: GrainSet) -> bool:
    """Whether all grains are one voxel layer thick: they have outlines, but no surfaces."""
    return all(np.count_nonzero(grain.volume.array.any(axis=(1, 2))) <= 1 for grain in grains.grains)


def surface_of(grain: Grain, voxel_size: float) -> Surface | None:
    """The surface of a grain whose reference has this voxel size, mm; None if it has no attenuation above its level."""
    mesh = grain_mesh(grain, voxel_size)
    if mesh is None:
        return None
    places = np.asarray(mesh.vertices, dtype=float)
    normals = _normals(places, mesh.faces)
    return Surface(places, normals, cKDTree(places), float(np.linalg.norm(places - grain.center, axis=1).max()))


def _normals(places: Float, faces: NDArray[np.integer]) -> Float:
    """Outward unit normals of the corners of a closed mesh whose faces are outward, means of those around by area."""
    a, b, c = (places[faces[:, k]] for k in range(3))
    of_faces = np.cross(b - a, c - a)
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
