"""Tetrahedra between the centres of grains, and the deformation gradient in each.

Delaunay's tetrahedra of the centres fill the sample; the displacement is linear in each of them, so F is constant there
and exact for a linear field.  The average of F over the tetrahedra around a grain, weighted by their volumes, is the
strain of the equivalent continuum at that grain (Bagi, Mechanics of Materials 22, 165, 1996).  Centres in one plane
give triangles, and F only in the plane.

At the hull Delaunay's tessellation spans hollows, and it has flat tetrahedra in which a small error of a translation
becomes a large strain.  Those on the hull are therefore taken off, one layer after the other, while one is flat
(mean ratio below `MIN_SHAPE`) or long (an edge beyond `MAX_HULL_EDGE` median edges).  Flat ones inside are kept: they
have hardly any volume, so hardly any weight in an average, and without them the tessellation had holes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.spatial import Delaunay, QhullError

from grainmotion._typing import Float
from grainmotion.mechanics.gradient_weights import GradientWeights, weights_from_entries

MIN_SHAPE = 0.2
"""Mean ratio (1 for a regular tetrahedron, 0 for a flat one) below which one at the hull is taken off."""
MAX_HULL_EDGE = 2.5
"""Longest edge of a tetrahedron at the hull, in median edges: beyond it, it spans a hollow or an open corner."""
MIN_CELL_VOLUME = 1e-9
"""Smallest volume of a tetrahedron, in median volumes; centres on a lattice give empty ones."""
FLAT_LAYER = 1e-9
"""Thickness along z below which centres lie in one plane, relative to their extent along x and y."""


@dataclass(frozen=True, eq=False)
class Tessellation:
    """Simplices between n points: tetrahedra, or triangles if all points have one z.

    Attributes
    ----------
    simplices : (m, 4) or (m, 3) int array
        Rows of their corners.
    volumes : (m,) array
        Volume, mm³, or area, mm².
    shapes : (m,) array
        Mean ratio: 1 for a regular simplex, 0 for a flat one.
    at_hull : (n,) bool array
        Points on the boundary of the simplices: what is averaged there comes from one side only.
    weights : GradientWeights
        Of F in each simplex.
    """

    simplices: NDArray[np.int64]
    volumes: Float
    shapes: Float
    at_hull: NDArray[np.bool_]
    weights: GradientWeights

    def averages(self, count: int) -> csr_array:
        """Matrix ``(count, m)`` that averages over the simplices around each point, by volume; empty without one."""
        rows = self.simplices.ravel()
        columns = np.repeat(np.arange(len(self.simplices)), self.simplices.shape[1])
        sums = np.bincount(rows, self.volumes[columns], count)
        return csr_array((self.volumes[columns] / sums[rows], (rows, columns)), shape=(count, len(self.simplices)))

    def volumes_around(self, count: int) -> Float:
        """Volume of the simplices around each point, ``(count,)``."""
        corners = self.simplices.shape[1]
        return np.bincount(self.simplices.ravel(), np.repeat(self.volumes, corners), count).astype(float)


def tessellate(points: Float) -> Tessellation:
    """Simplices between points ``(n, 3)``, mm; none if the points span no volume and lie in no plane of one z."""
    extent = np.ptp(points, axis=0) if len(points) else np.zeros(3)
    planar = len(points) > 0 and extent[2] <= FLAT_LAYER * extent[:2].max()
    dimension = 2 if planar else 3
    try:
        if len(points) <= dimension or not np.isfinite(points).all():
            raise QhullError
        found = Delaunay(points[:, :dimension] - points[:, :dimension].mean(axis=0))
        simplices, neighbours = found.simplices.astype(np.int64), found.neighbors.astype(np.int64)
    except QhullError:  # fewer points than corners, or all of them on a line or a plane
        simplices = neighbours = np.zeros((0, dimension + 1), dtype=np.int64)
    corners = points[simplices][:, :, :dimension]
    edges = corners[:, 1:] - corners[:, :1]
    volumes = np.abs(np.linalg.det(edges)) / (6 if dimension == 3 else 2)
    shapes, longest = _shapes(corners, volumes)
    kept, outside = _peeled(neighbours, volumes, shapes, longest)
    at_hull = _on_hull(simplices[kept], outside[kept], len(points))
    simplices, volumes, shapes, edges = simplices[kept], volumes[kept], shapes[kept], edges[kept]
    gradients = np.zeros((len(simplices), dimension + 1, 3))
    gradients[:, 1:, :dimension] = np.swapaxes(np.linalg.inv(edges), 1, 2)
    gradients[:, 0] = -gradients[:, 1:].sum(axis=1)
    rows = np.repeat(np.arange(len(simplices)), dimension + 1)
    shape = (len(simplices), len(points))
    weights = weights_from_entries(rows, simplices.ravel(), gradients.reshape(-1, 3), shape)
    return Tessellation(simplices, volumes, shapes, at_hull, weights)


def _shapes(corners: Float, volumes: Float) -> tuple[Float, Float]:
    """Mean ratio (Liu and Joe, BIT 34, 268, 1994) and longest edge of simplices ``(m, corners, dimension)``."""
    count, dimension = corners.shape[1:]
    pairs = np.triu_indices(count, 1)
    lengths = np.linalg.norm(corners[:, pairs[0]] - corners[:, pairs[1]], axis=2).reshape(-1, len(pairs[0]))
    squares = (lengths**2).sum(axis=1)
    scaled = 12 * np.cbrt(9 * volumes**2) if dimension == 3 else 4 * np.sqrt(3) * volumes
    return scaled / np.where(squares > 0, squares, 1.0), lengths.max(axis=1, initial=0.0)


def _peeled(
    neighbours: NDArray[np.int64], volumes: Float, shapes: Float, longest: Float
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which simplices stay when poor ones are taken off the hull, layer by layer; which of their faces are outside.

    Column k of the faces ``(m, corners)`` is the one opposite to corner k.  Empty simplices are dropped as well, but
    where they lie inside there is none of the hull beside them.
    """
    if not len(volumes):
        return np.zeros(0, dtype=bool), np.zeros(neighbours.shape, dtype=bool)
    present = np.ones(len(volumes), dtype=bool)
    poor = (shapes < MIN_SHAPE) | (longest > MAX_HULL_EDGE * np.median(longest))
    while True:
        outside = (neighbours < 0) | ~present[neighbours]
        peeled = present & poor & outside.any(axis=1)
        if not peeled.any():
            return present & (volumes > MIN_CELL_VOLUME * np.median(volumes)), outside
        present &= ~peeled


def _on_hull(simplices: NDArray[np.int64], outside: NDArray[np.bool_], count: int) -> NDArray[np.bool_]:
    """Corners of faces that are outside, ``(count,)``."""
    at_hull = np.zeros(count, dtype=bool)
    for corner in range(simplices.shape[1]):
        faces = np.delete(simplices, corner, axis=1)[outside[:, corner]]
        at_hull[faces.ravel()] = True
    return at_hull
