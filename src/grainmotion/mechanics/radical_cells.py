"""Radical Voronoi cells (Laguerre, power diagram): where |x − c|² − r² is least for the ball of centre c, radius r.

Each cell is an intersection of half-spaces, one for each ball near enough to cut it and one for each face of the field.
When centre j moves by δ, a point x of the face between cells i and j moves outwards from i by (cⱼ − x)·δ/|cⱼ − cᵢ|;
when centre i moves, by (x − cᵢ)·δ/|cⱼ − cᵢ|.  The mean over the face, times its area, is the gain of cell i.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, HalfspaceIntersection, QhullError, cKDTree

from grainmotion._typing import Float
from grainmotion.model.progress import counted
from grainmotion.model.volume import Volume

FIRST_NEIGHBOURS = 30
"""Grains whose planes first bound a radical cell; more are taken until none further away can cut it."""


def radical_cells(centers: Float, radii: Float, grid: Volume) -> tuple[Float, NDArray[np.bool_]]:
    """Volumes of the radical cells within the grid, mm³, and whether its border does not cut them."""
    n = len(centers)
    low, high, walls = _field(grid)
    volumes, inside = np.zeros(n), np.zeros(n, dtype=bool)
    for i, cell in _cells(centers, radii, walls):
        volumes[i] = ConvexHull(cell.corners).volume
        tolerance = 1e-6 * grid.voxel_size
        off_border = (cell.corners > low + tolerance) & (cell.corners < high - tolerance)
        inside[i] = off_border[:, : 2 if grid.shape[0] == 1 else 3].all()
    return volumes, inside


def cell_variances(centers: Float, radii: Float, grid: Volume, covariances: Float) -> Float:
    """Variances ``(n,)`` of the volumes of radical cells, mm⁶, from covariances of the centres ``(n, 3, 3)``, mm².

    Errors of different centres are taken as independent; NaN where one that bounds the cell has none.
    """
    variances = np.zeros(len(centers))
    for i, cell in counted(_cells(centers, radii, _field(grid)[2]), len(centers)):
        own = np.zeros(3)
        for j, area, middle in cell.faces():
            scaled = area / np.linalg.norm(centers[j] - centers[i])
            own += scaled * (middle - centers[i])
            variances[i] += scaled**2 * (centers[j] - middle) @ covariances[j] @ (centers[j] - middle)
        variances[i] += own @ covariances[i] @ own
    return variances


@dataclass(frozen=True, eq=False)
class _Cell:
    """Corners of a cell, the planes that meet at each, and the grains behind the planes (the field's come last)."""

    corners: Float
    planes_at: list[list[int]]
    planes: Float
    others: NDArray[np.int64]

    def faces(self) -> Iterator[tuple[int, float, Float]]:
        """The other grain, area and centroid of each face between two cells."""
        at: list[list[int]] = [[] for _ in self.others]
        for corner, meeting in enumerate(self.planes_at):
            for plane in meeting:
                if plane < len(self.others):
                    at[plane].append(corner)
        for plane, rows in enumerate(at):
            if len(rows) >= 3:
                area, middle = _polygon(self.corners[rows], self.planes[plane, :3])
                yield int(self.others[plane]), area, middle


def _polygon(corners: Float, normal: Float) -> tuple[float, Float]:
    """Area and centroid of a convex polygon of corners in any order."""
    middle = corners.mean(axis=0)
    first = np.linalg.svd(normal[None])[2][1]
    second = np.cross(normal, first)
    offsets = corners - middle
    offsets = offsets[np.argsort(np.arctan2(offsets @ second, offsets @ first))]
    following = np.roll(offsets, -1, axis=0)
    areas = np.cross(offsets, following) @ normal / 2
    total = float(areas.sum())
    if total <= 0:
        return 0.0, middle
    return total, middle + areas @ (offsets + following) / 3 / total


def _field(grid: Volume) -> tuple[Float, Float, Float]:
    """Lowest and highest corner of the field, and its planes."""
    low = grid.origin - grid.voxel_size / 2
    high = low + grid.voxel_size * np.array(grid.shape[::-1])
    return low, high, np.vstack([np.column_stack([-np.eye(3), low]), np.column_stack([np.eye(3), -high])])


def _cells(centers: Float, radii: Float, walls: Float) -> Iterator[tuple[int, _Cell]]:
    """Cells that are not empty."""
    tree = cKDTree(centers) if len(centers) else None
    for i in range(len(centers)):
        assert tree is not None
        cell = _cell(i, centers, radii, walls, tree)
        if cell is not None:
            yield i, cell


def _cell(i: int, centers: Float, radii: Float, walls: Float, tree: cKDTree) -> _Cell | None:
    """One radical cell: points whose power distance |x − c|² − r² to grain i is the least; None if empty."""
    count = FIRST_NEIGHBOURS
    while True:
        apart, others = tree.query(centers[i], k=min(count, len(centers)))
        others, apart = np.atleast_1d(others), np.atleast_1d(apart)
        keep = others != i
        planes, behind = _planes(i, others[keep], centers, radii)
        met = _corners(np.vstack([planes, walls]), centers[i])
        if met is None:
            return None
        corners, planes_at = met
        # j cuts no corner if its power distance there is larger than that of i, whatever its radius
        reach = np.linalg.norm(corners - centers[i], axis=1).max()
        safe = reach + np.sqrt(max(reach**2 - radii[i] ** 2 + radii.max() ** 2, 0.0))
        if count >= len(centers) or apart.max() > safe:
            return _Cell(corners, planes_at, planes, behind)
        count *= 2


def _planes(i: int, others: NDArray[np.int64], centers: Float, radii: Float) -> tuple[Float, NDArray[np.int64]]:
    """Half-spaces ``(k, 4)``, n·x + b ≤ 0, of points nearer to i than to others in power distance, and those others."""
    normals = 2 * (centers[others] - centers[i])
    squares = (centers**2).sum(axis=1) - radii**2
    offsets = squares[i] - squares[others]
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    good = lengths[:, 0] > 0
    return np.column_stack([normals, offsets])[good] / lengths[good], others[good]


def _corners(planes: Float, center: Float) -> tuple[Float, list[list[int]]] | None:
    """Corners of an intersection of half-spaces, and the planes that meet at each; None if it is empty."""
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
        found_cell = HalfspaceIntersection(planes, inside)
    except QhullError:
        return None
    corners = np.asarray(found_cell.intersections)
    finite = np.asarray(np.isfinite(corners).all(axis=1))
    return corners[finite], [
        list(meeting) for meeting, keep in zip(found_cell.dual_facets, finite, strict=True) if keep
    ]
