"""Radical Voronoi cells (Laguerre, power diagram): where |x − c|² − r² is least for the ball of centre c, radius r.

Each cell is an intersection of half-spaces, one for each ball near enough to cut it and one for each face of the field.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, HalfspaceIntersection, QhullError, cKDTree

from grainmotion._typing import Float
from grainmotion.model.volume import Volume

FIRST_NEIGHBOURS = 30
"""Grains whose planes first bound a radical cell; more are taken until none further away can cut it."""


def radical_cells(centers: Float, radii: Float, grid: Volume) -> tuple[Float, NDArray[np.bool_]]:
    """Volumes of the radical cells within the grid, mm³, and whether its border does not cut them."""
    n = len(centers)
    low = grid.origin - grid.voxel_size / 2
    high = low + grid.voxel_size * np.array(grid.shape[::-1])
    walls = np.vstack([np.column_stack([-np.eye(3), low]), np.column_stack([np.eye(3), -high])])
    volumes, inside = np.zeros(n), np.zeros(n, dtype=bool)
    tree = cKDTree(centers) if n else None
    for i in range(n):
        assert tree is not None
        corners = _cell_corners(i, centers, radii, walls, tree)
        if corners is not None:
            volumes[i] = ConvexHull(corners).volume
            tolerance = 1e-6 * grid.voxel_size
            off_border = (corners > low + tolerance) & (corners < high - tolerance)
            inside[i] = off_border[:, : 2 if grid.shape[0] == 1 else 3].all()
    return volumes, inside


def _cell_corners(i: int, centers: Float, radii: Float, walls: Float, tree: cKDTree) -> Float | None:
    """Corners of one radical cell: points whose power distance |x − c|² − r² to grain i is the least; None if empty."""
    count = FIRST_NEIGHBOURS
    while True:
        apart, others = tree.query(centers[i], k=min(count, len(centers)))
        others, apart = np.atleast_1d(others), np.atleast_1d(apart)
        keep = others != i
        planes = _planes(i, others[keep], centers, radii)
        corners = _corners(np.vstack([planes, walls]), centers[i])
        if corners is None:
            return None
        # j cuts no corner if its power distance there is larger than that of i, whatever its radius
        reach = np.linalg.norm(corners - centers[i], axis=1).max()
        safe = reach + np.sqrt(max(reach**2 - radii[i] ** 2 + radii.max() ** 2, 0.0))
        if count >= len(centers) or apart.max() > safe:
            return corners
        count *= 2


def _planes(i: int, others: NDArray[np.int64], centers: Float, radii: Float) -> Float:
    """Half-spaces ``(k, 4)``, n·x + b ≤ 0, of points nearer to i than to others in power distance."""
    normals = 2 * (centers[others] - centers[i])
    squares = (centers**2).sum(axis=1) - radii**2
    offsets = squares[i] - squares[others]
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    good = lengths[:, 0] > 0
    return np.column_stack([normals, offsets])[good] / lengths[good]


def _corners(planes: Float, center: Float) -> Float | None:
    """Corners of an intersection of half-spaces; None if it is empty."""
    inside = center
    if (planes[:, :3] @ center + planes[:, 3] > -1e-9).any():  # a small grain may lie outside its own cell
        found = linprog(
            [0, 0, 0, -1],
            A_ub=np.column_stack([planes[:, :3], np.ones(len(planes))]),
            b_ub=-planes[:, 3],
            bounds=[(None, None)] * 3 + [(0, None)],
        )
        if not found.success or found.x is None or found.x[3] <= 0:
            return None
        inside = np.asarray(found.x[:3])
    try:
        corners = HalfspaceIntersection(planes, inside).intersections
    except QhullError:
        return None
    return np.asarray(corners[np.isfinite(corners).all(axis=1)])
