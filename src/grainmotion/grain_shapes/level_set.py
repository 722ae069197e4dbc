"""Signed distance to a closed surface on a regular grid, negative inside.

Near the surface the distance is that to the nearest triangle.  Further away, where no contact needs it, a vertex near
the foot of the perpendicular is known: the distance is that to the plane of the surface there, as far as it is between
the largest and the smallest that such a vertex allows.  The sign counts how often, and in which direction,
a line from the point along +z leaves the solid: it needs no normals at edges and corners.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.grain_shapes.triangle_mesh import Surface, subdivided
from grainmotion.model.summary import Summarised

LONGEST_EDGE = 2.0
"""Longest edge of a triangle, over the spacing of the grid."""
EXACT_BAND = 3.0
"""Distance up to which the nearest triangle is looked for, over the spacing."""
NEAR_TRIANGLES = 12
"""Triangles among which the nearest is looked for: those with the nearest centres."""
MAX_GRID_POINTS = 10_000_000
"""Points of the largest grid: a gigabyte while it is computed."""
OFF_GRID = np.array([0.3713e-6, 0.6187e-6])
"""Shift of the grid along x and y for the sign, over the spacing: no line meets an edge of a symmetric mesh."""


@dataclass(frozen=True, eq=False, repr=False)
class LevelSet(Summarised):
    """Signed distance to a surface at the points of a regular grid.

    Attributes
    ----------
    values : (nz, ny, nx) array
        mm, negative inside.
    spacing : float
        Distance of neighbouring points, mm.
    origin : (3,) array
        Place of point [0, 0, 0], mm, x y z, in the frame of the surface.

    Examples
    --------
    >>> field = gm.level_set(gm.grain_surface(grains.grains[0]), spacing=0.2)
    >>> bool(field.values.min() < 0 < field.values.max())  # negative inside
    True
    """

    values: Float
    spacing: float
    origin: Float

    @property
    def points(self) -> Float:
        """Places of the points ``(nz, ny, nx, 3)``, mm, x y z."""
        z, y, x = np.meshgrid(*(np.arange(n) for n in self.values.shape), indexing="ij")
        return self.origin + self.spacing * np.stack([x, y, z], axis=-1)


@checked_arguments
def level_set(surface: Surface, spacing: float, *, margin: float = 3.0) -> LevelSet:
    """Signed distance to a surface on a regular grid around it, as level-set DEM uses it.

    Parameters
    ----------
    surface : Surface
        Closed, facing outwards, mm.
    spacing : float
        Of the grid's points, mm; the voxel size, or half of it, as a rule.
    margin : float
        Least distance between the surface and the border of the grid, over the spacing.

    Returns
    -------
    LevelSet
        Distances in mm, negative inside.

    Raises
    ------
    InputError
        If the spacing is not positive, or so small that the grid has more than 10 million points.

    Examples
    --------
    >>> field = gm.level_set(gm.grain_surface(grains.grains[0]), spacing=0.2)
    >>> field.values.ndim, field.spacing
    (3, 0.2)
    """
    if not spacing > 0:
        raise InputError("level_set.spacing", f"must be > 0, got {spacing}", "give it in mm")
    if not margin >= 1:
        raise InputError("level_set.margin", f"must be at least 1, got {margin}", "give 2 or more")
    low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
    shape = np.ceil((high - low) / spacing + 2 * margin).astype(int) + 1
    if np.prod(shape.astype(float)) > MAX_GRID_POINTS:
        raise InputError("level_set.spacing", f"{spacing} mm gives {np.prod(shape):,} points", "give a larger one")
    origin = (low + high) / 2 - spacing * (shape - 1) / 2
    grid = LevelSet(np.zeros(tuple(shape[::-1])), spacing, origin)
    fine = subdivided(surface, LONGEST_EDGE * spacing)
    distance = _distances(fine, grid)
    return LevelSet(np.where(_inside(fine, grid), -distance, distance), spacing, origin)


def _distances(surface: Surface, grid: LevelSet) -> Float:
    """Distances of the grid's points to the surface ``(nz, ny, nx)``, mm."""
    vertices = surface.vertices
    cells = tuple(np.rint((vertices - grid.origin) / grid.spacing).astype(np.int64)[:, ::-1].T)
    vertex_of_cell = np.full(grid.values.shape, -1, dtype=np.int64)
    vertex_of_cell[cells] = np.arange(len(vertices))
    steps, nearest = distance_transform_edt(vertex_of_cell < 0, return_indices=True)
    near = steps < EXACT_BAND + 1
    points, vertex = grid.points, vertex_of_cell[tuple(nearest)]
    gaps = points - vertices[vertex]
    square = np.einsum("...i,...i->...", gaps, gaps)
    height = np.abs(np.einsum("...i,...i->...", gaps, _vertex_normals(surface)[vertex]))
    distances = np.clip(height, np.sqrt(np.maximum(square - grid.spacing**2, 0)), np.sqrt(square))
    distances[near] = _near_distances(surface, points[near], grid.spacing)
    return distances


def _vertex_normals(surface: Surface) -> Float:
    """Unit normals at the vertices ``(n, 3)``: means of those of the triangles around, by their area."""
    a, b, c = surface.corners.transpose(1, 0, 2)
    weighted, corners = np.repeat(np.cross(b - a, c - a), 3, axis=0), surface.faces.ravel()
    sums = [np.bincount(corners, part, minlength=len(surface.vertices)) for part in weighted.T]
    normals = np.stack(sums, axis=1)
    return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300))


def _near_distances(surface: Surface, points: Float, spacing: float) -> Float:
    """Distances of points ``(n, 3)`` near the surface, mm."""
    distances = np.array(cKDTree(surface.vertices).query(points)[0], dtype=float)
    near = np.flatnonzero(distances < (EXACT_BAND + 1) * spacing)
    corners = surface.corners
    count = min(NEAR_TRIANGLES, len(corners))
    _, index = cKDTree(corners.mean(axis=1)).query(points[near], k=count)
    for column in np.asarray(index).reshape(len(near), count).T:
        distances[near] = np.minimum(distances[near], _to_triangles(points[near], corners[column]))
    return distances


def _to_triangles(points: Float, corners: Float) -> Float:
    """Distance of each point ``(n, 3)`` to its triangle ``(n, 3, 3)``."""
    a, b, c = corners.transpose(1, 0, 2)
    best = np.full(len(points), np.inf)
    for start, end in ((a, b), (b, c), (c, a)):
        edge = end - start
        length = np.maximum(np.einsum("ij,ij->i", edge, edge), 1e-300)
        along = np.clip(np.einsum("ij,ij->i", points - start, edge) / length, 0, 1)
        gap = points - start - along[:, None] * edge
        best = np.minimum(best, np.einsum("ij,ij->i", gap, gap))
    normal = np.cross(b - a, c - a)
    square = np.einsum("ij,ij->i", normal, normal)
    above = square > 0
    for start, end in ((a, b), (b, c), (c, a)):
        above &= np.einsum("ij,ij->i", np.cross(end - start, points - start), normal) >= 0
    height = np.einsum("ij,ij->i", points - a, normal) ** 2 / np.maximum(square, 1e-300)
    return np.sqrt(np.where(above, np.minimum(best, height), best))


def _inside(surface: Surface, grid: LevelSet) -> NDArray[np.bool_]:
    """Points of the grid inside the surface, (nz, ny, nx)."""
    nz, ny, nx = grid.values.shape
    corners = (surface.corners - grid.origin) / grid.spacing
    corners[..., :2] += OFF_GRID
    first = np.ceil(corners[..., :2].min(axis=1)).astype(int)
    count = np.floor(corners[..., :2].max(axis=1)).astype(int) - first + 1
    crossings = np.zeros((nz + 1, ny, nx), dtype=np.int32)
    for dx in range(int(count[:, 0].max(initial=0))):
        for dy in range(int(count[:, 1].max(initial=0))):
            some = np.flatnonzero((count[:, 0] > dx) & (count[:, 1] > dy))
            column = first[some] + (dx, dy)
            hit, heights, signs = _pierced(corners[some], column)
            z = np.clip(np.ceil(heights[hit]).astype(int), 0, nz)
            np.add.at(crossings, (z, column[hit, 1], column[hit, 0]), signs[hit])
    above = crossings.sum(axis=0) - np.cumsum(crossings, axis=0)[:nz]  # crossings above each point
    return above > 0


def _pierced(corners: Float, columns: NDArray[np.int64]) -> tuple[NDArray[np.bool_], Float, NDArray[np.int32]]:
    """Whether vertical lines at ``columns`` pierce their triangles, at which heights, and up- (+1) or downwards."""
    a, b, c = corners.transpose(1, 0, 2)

    def side(p: Float, q: Float) -> Float:
        return (q[:, 0] - p[:, 0]) * (columns[:, 1] - p[:, 1]) - (q[:, 1] - p[:, 1]) * (columns[:, 0] - p[:, 0])

    weights = np.stack([side(b, c), side(c, a), side(a, b)], axis=1)
    hit = np.asarray((weights > 0).all(axis=1) | (weights < 0).all(axis=1), dtype=bool)
    total = weights.sum(axis=1)
    heights = np.zeros(len(corners))
    heights[hit] = np.einsum("ij,ij->i", weights[hit], corners[hit, :, 2]) / total[hit]
    return hit, heights, np.asarray(np.sign(total), dtype=np.int32)


def surface_nodes(surface: Surface, spacing: float) -> Float:
    """Vertices spread over a surface ``(k, 3)``, mm: one in each cube of this edge that holds any."""
    cells = np.floor((surface.vertices - surface.vertices.min(axis=0)) / spacing).astype(np.int64)
    _, first = np.unique(cells, axis=0, return_index=True)
    return surface.vertices[np.sort(first)]
