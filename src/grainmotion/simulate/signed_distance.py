"""Which point lies inside which star-shaped mesh, and how deep (see `walk` for how it is found)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from grainmotion._typing import Float
from grainmotion.kernels import star_mesh
from grainmotion.kernels.star_mesh import MAP
from grainmotion.simulate.shapes import Ellipsoid, Mesh, Shape, icosphere


@dataclass(frozen=True, eq=False)
class Locator:
    """A star-shaped mesh about the origin, ready for point location.

    Attributes
    ----------
    vertices, faces : (m, 3), (k, 3) arrays
    planes : (k, 4) array
        Outward unit normal and distance from the origin of each triangle's plane.
    across : (k, 3) array
        Triangle on the other side of the edges 0–1, 1–2, 2–0.
    start : (MAP, MAP) array
        A triangle near the direction of each cell.
    reach : (MAP, MAP) array
        A radius that the mesh does not exceed in the directions of each cell.
    probes : (p, 3) array
        Points of the surface, the coarse ones first.
    """

    vertices: Float
    faces: NDArray[np.int32]
    planes: Float
    across: NDArray[np.int32]
    start: NDArray[np.int32]
    reach: Float
    probes: Float

    @property
    def radius(self) -> float:
        """Radius of the smallest sphere about the origin that holds the mesh, mm."""
        return float(np.linalg.norm(self.vertices, axis=1).max())


def locator(shape: Shape, level: int = 4) -> tuple[Locator, Float]:
    """Locator of a shape (an ellipsoid by a mesh just outside it), and the point that is its origin."""
    if isinstance(shape, Ellipsoid):
        directions, triangles = icosphere(level)
        lowest = _planes(directions, triangles)[:, 3].min()
        mesh = Mesh(directions / lowest * shape.semi_axes @ shape.axes.T, triangles, np.zeros(3))
        return _locator(mesh), shape.center
    mesh = shape.moved(np.eye(3), -shape.star_point)
    body = _locator(mesh)
    if len(mesh.vertices) < len(icosphere(level)[0]):  # large facets: probe them inside and along their edges
        hits = surface_points(body, icosphere(level)[0])
        a, b = (mesh.vertices[mesh.faces[:, i]] for i in (0, 1))
        steps = np.linspace(0, 1, 12)[:-1, None, None]
        body = replace(body, probes=np.concatenate([hits, ((1 - steps) * a + steps * b).reshape(-1, 3)]))
    return body, shape.star_point


def signed_distances(body: Locator, points: Float) -> Float:
    """Distances of points ``(m, 3)`` to the plane of the triangle that they look through; negative inside."""
    out = np.empty(len(points))
    star_mesh.distances(points, body.vertices, body.faces, body.planes, body.across, body.start, out)
    return out


def surface_points(body: Locator, directions: Float) -> Float:
    """Where directions ``(m, 3)`` from the origin leave the mesh, ``(m, 3)``."""
    out = np.empty_like(directions)
    star_mesh.hits(directions, body.vertices, body.faces, body.planes, body.across, body.start, out)
    return out


def _locator(mesh: Mesh) -> Locator:
    faces = mesh.faces.astype(np.int32)
    vertices = np.ascontiguousarray(mesh.vertices)
    planes = _planes(vertices, faces)
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    first, second = order[0::2], order[1::2]  # the two triangles' sides of each edge
    across = np.empty(faces.shape, np.int32)
    across.flat[first], across.flat[second] = second // 3, first // 3
    start, reach = np.zeros((MAP, MAP), np.int32), np.zeros((MAP, MAP))
    star_mesh.fill_map(vertices, faces, planes, across, start, reach)
    return Locator(vertices, faces, planes, across, start, _widened(reach), vertices)


def _planes(vertices: Float, faces: NDArray[np.integer]) -> Float:
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return np.concatenate([normals, np.einsum("ij,ij->i", normals, a)[:, None]], axis=1)


def _widened(reach: Float) -> Float:
    """The largest of each cell and its eight neighbours; the map's borders meet their own mirror images."""
    padded = np.pad(reach, 1)
    padded[0, 1:-1], padded[-1, 1:-1] = reach[0, ::-1], reach[-1, ::-1]
    padded[1:-1, 0], padded[1:-1, -1] = reach[::-1, 0], reach[::-1, -1]
    corner = slice(None, None, MAP + 1)
    padded[corner, corner] = reach[[0, 0, -1, -1], [0, -1, 0, -1]].max()  # the four corners are one point
    return maximum_filter(padded, size=3)[1:-1, 1:-1].copy()
