"""Signed distance of points to a star-shaped mesh; see `kernels.star_mesh` for the search."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from grainmotion._typing import Float
from grainmotion.kernels import star_mesh
from grainmotion.kernels.star_mesh import MAP_CELLS
from grainmotion.simulate.polyhedra import icosphere
from grainmotion.simulate.shapes import Ellipsoid, Mesh, Shape, face_planes


@dataclass(frozen=True, eq=False)
class Locator:
    """A star-shaped mesh about the origin, prepared for point location; lengths in mm."""

    vertices: Float  # (m, 3)
    faces: NDArray[np.int32]  # (k, 3)
    planes: Float  # (k, 4): outward unit normal of each face's plane, and its distance from the origin
    across: NDArray[np.int32]  # (k, 3): face on the other side of the edges 0–1, 1–2, 2–0
    start: NDArray[np.int32]  # (MAP_CELLS, MAP_CELLS): face at which the search for a direction in this cell starts
    reach: Float  # (MAP_CELLS, MAP_CELLS): upper bound of the radius in the directions of each cell
    probes: Float  # (p, 3): surface points that are tested for overlap with other bodies, a coarse subset first

    @property
    def radius(self) -> float:
        """Radius of the smallest sphere about the origin around the mesh, mm."""
        return float(np.linalg.norm(self.vertices, axis=1).max())


def locator(shape: Shape, level: int = 4) -> tuple[Locator, Float]:
    """Locator of a shape (an ellipsoid becomes a circumscribed mesh), and the point that is its origin."""
    if isinstance(shape, Ellipsoid):
        directions, triangles = icosphere(level)
        inner_radius = face_planes(directions, triangles)[:, 3].min()
        mesh = Mesh(directions / inner_radius * shape.semi_axes @ shape.axes.T, triangles, np.zeros(3))
        return _locator(mesh), shape.center
    mesh = shape.moved(np.eye(3), -shape.star_point)
    body = _locator(mesh)
    if len(mesh.vertices) < len(icosphere(level)[0]):  # large facets: add probes inside them and along their edges
        hits = surface_points(body, icosphere(level)[0])
        a, b = (mesh.vertices[mesh.faces[:, i]] for i in (0, 1))
        steps = np.linspace(0, 1, 12)[:-1, None, None]
        body = replace(body, probes=np.concatenate([hits, ((1 - steps) * a + steps * b).reshape(-1, 3)]))
    return body, shape.star_point


def signed_distances(body: Locator, points: Float) -> Float:
    """Distance ``(m,)`` of points ``(m, 3)`` to the plane of the triangle in their direction; negative inside."""
    out = np.empty(len(points))
    star_mesh.distances(points, body.vertices, body.faces, body.planes, body.across, body.start, out)
    return out


def surface_points(body: Locator, directions: Float) -> Float:
    """Surface points ``(m, 3)`` in the directions ``(m, 3)`` from the origin."""
    out = np.empty_like(directions)
    star_mesh.hits(directions, body.vertices, body.faces, body.planes, body.across, body.start, out)
    return out


def _locator(mesh: Mesh) -> Locator:
    faces = mesh.faces.astype(np.int32)
    vertices = np.ascontiguousarray(mesh.vertices)
    planes = face_planes(vertices, faces)
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    first, second = order[0::2], order[1::2]  # the two triangles' sides of each edge
    across = np.empty(faces.shape, np.int32)
    across.flat[first], across.flat[second] = second // 3, first // 3
    start, reach = np.zeros((MAP_CELLS, MAP_CELLS), np.int32), np.zeros((MAP_CELLS, MAP_CELLS))
    star_mesh.fill_map(vertices, faces, planes, across, start, reach)
    return Locator(vertices, faces, planes, across, start, _widened(reach), vertices)


def _widened(reach: Float) -> Float:
    """Maximum over each cell and its eight neighbours; each border of the map continues in its mirror image."""
    padded = np.pad(reach, 1)
    padded[0, 1:-1], padded[-1, 1:-1] = reach[0, ::-1], reach[-1, ::-1]
    padded[1:-1, 0], padded[1:-1, -1] = reach[::-1, 0], reach[::-1, -1]
    corner = slice(None, None, MAP_CELLS + 1)
    padded[corner, corner] = reach[[0, 0, -1, -1], [0, -1, 0, -1]].max()  # the four corners are one point
    return maximum_filter(padded, size=3)[1:-1, 1:-1].copy()
