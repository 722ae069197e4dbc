"""Meshes for display: few triangles a grain, however many voxels it has."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float

DISPLAY_CELLS = 32
"""Cells along the longest edge of a grain's box: about 5 000 triangles, as smooth as a figure shows."""


@dataclass(frozen=True, eq=False)
class DisplayMesh:
    """Triangles of one grain in the reference state, in single precision.

    Attributes
    ----------
    vertices : (n, 3) float32 array
        mm, x y z.
    faces : (m, 3) int32 array
        Rows of vertices, counter-clockwise seen from outside.
    """

    vertices: NDArray[np.float32]
    faces: NDArray[np.int32]


def display_mesh(vertices: Float, faces: NDArray[np.integer], voxel_size: float) -> DisplayMesh:
    """The mesh with all vertices in one cell merged into their mean, and without triangles that vanish.

    A cell is a voxel, or as much larger as `DISPLAY_CELLS` along the longest edge of the box ask for.  (Vertex
    clustering: Rossignac & Borrel, Modeling in Computer Graphics, 1993.)
    """
    low = vertices.min(axis=0)
    cell = max(voxel_size, float((vertices.max(axis=0) - low).max()) / DISPLAY_CELLS)
    places = np.floor((vertices - low) / cell).astype(np.int64)
    _, owner = np.unique(places, axis=0, return_inverse=True)
    owner = owner.ravel()
    counts = np.bincount(owner)
    merged = np.stack([np.bincount(owner, vertices[:, k]) / counts for k in range(3)], axis=1)
    triangles = owner[faces]
    whole = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
    return DisplayMesh(merged.astype(np.float32), triangles[whole].astype(np.int32))
