"""The surface of a grain as triangles, and fewer triangles for display.

The surface is where the grain's own attenuation, filtered by a Gaussian of `SURFACE_SIGMA` voxels, falls to half of
what is typical of the grain.  Between two grains that touch, labels cut it there along the faces of voxels; the filter
takes their steps away.  A filter moves a curved surface inwards, by σ²/R for a sphere of radius R.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from skimage.measure import marching_cubes

from grainmotion.analysis.deformed_volume import typical_attenuation
from grainmotion.model.grains import Grain

SURFACE_SIGMA = 0.7
"""Width of the Gaussian filter under which a surface is found, voxels of the reference."""
DISPLAY_CELLS = 32
"""Cells along the longest edge of a grain's box: about 5 000 triangles, as smooth as a figure shows."""


@dataclass(frozen=True, eq=False)
class GrainMesh:
    """Triangles of one grain in the reference state.

    Attributes
    ----------
    vertices : (n, 3) array
        mm, x y z, sample frame.
    faces : (m, 3) int array
        Rows of vertices, counter-clockwise seen from outside.
    """

    vertices: NDArray[np.floating]
    faces: NDArray[np.integer]


def grain_mesh(grain: Grain, voxel_size: float) -> GrainMesh | None:
    """The surface of a grain whose reference has this voxel size, mm; None if it has no attenuation above its level."""
    volume = grain.volume if grain.fine is None else grain.fine
    level = typical_attenuation(grain) / 2
    if level <= 0:
        return None
    sigma = SURFACE_SIGMA * voxel_size / volume.voxel_size
    field = ndimage.gaussian_filter(np.pad(volume.array, 2), sigma, mode="constant")
    bodies, count = ndimage.label(field > level)
    layers = np.count_nonzero(volume.array.any(axis=(1, 2)))  # a slice is padded like any grain
    if count == 0 or layers < 2:
        return None
    if count > 1:  # specks of noise are no surface of the grain
        largest = 1 + int(np.argmax(np.bincount(bodies.ravel())[1:]))
        field = np.where((bodies == largest) | (bodies == 0), field, 0)
    corners, faces, _, _ = marching_cubes(field, level)
    places = (corners[:, ::-1].astype(float) - 2) * volume.voxel_size + volume.origin
    a, b, c = (places[faces] - places.mean(axis=0)).transpose(1, 0, 2)
    outwards = np.einsum("ij,ij->", a, np.cross(b, c)) > 0
    return GrainMesh(places, faces if outwards else faces[:, ::-1])


def display_mesh(mesh: GrainMesh, voxel_size: float) -> GrainMesh:
    """A mesh with all vertices in one cell merged into their mean, without triangles that vanish; single precision.

    A cell is a voxel, or as much larger as `DISPLAY_CELLS` along the longest edge of the box ask for.  (Vertex
    clustering: Rossignac & Borrel, Modeling in Computer Graphics, 1993.)
    """
    low = mesh.vertices.min(axis=0)
    cell = max(voxel_size, float((mesh.vertices.max(axis=0) - low).max()) / DISPLAY_CELLS)
    places = np.floor((mesh.vertices - low) / cell).astype(np.int64)
    _, owner = np.unique(places, axis=0, return_inverse=True)
    owner = owner.ravel()
    counts = np.bincount(owner)
    merged = np.stack([np.bincount(owner, mesh.vertices[:, k]) / counts for k in range(3)], axis=1)
    triangles = owner[mesh.faces]
    whole = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
    return GrainMesh(merged.astype(np.float32), triangles[whole].astype(np.int32))
