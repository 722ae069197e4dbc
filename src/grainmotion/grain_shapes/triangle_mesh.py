"""Closed triangle meshes: the check that they are closed and oriented, their parts, finer triangles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.model.summary import Summarised

MAX_SUBDIVISIONS = 8  # of triangles that are much longer than what they are compared with


@dataclass(frozen=True, eq=False, repr=False)
class Surface(Summarised):
    """A closed surface of triangles that face outwards.

    Attributes
    ----------
    vertices : (n, 3) array
        mm, x y z.
    faces : (m, 3) int array
        Vertices of each triangle, counter-clockwise seen from outside.

    Raises
    ------
    InputError
        If the mesh is empty, an index is out of range, an edge is not shared by two triangles that run along it in
        opposite directions, or the triangles face inwards.

    Examples
    --------
    >>> tetrahedron = gm.Surface(
    ...     np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]),
    ...     np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]),
    ... )
    >>> round(tetrahedron.volume, 4), tetrahedron.euler_characteristic
    (0.1667, 2)
    """

    vertices: Float
    faces: NDArray[np.int64]

    def __post_init__(self) -> None:
        vertices = np.asarray(self.vertices, dtype=float)
        faces = np.asarray(self.faces, dtype=np.int64)
        remedy = "give a closed mesh with outward triangles"
        if vertices.ndim != 2 or vertices.shape[1:] != (3,) or not np.isfinite(vertices).all():
            raise InputError("surface.vertices", f"shape {vertices.shape}, or NaN in it", "give finite (n, 3)")
        if faces.ndim != 2 or faces.shape[1:] != (3,) or not len(faces):
            raise InputError("surface.faces", f"shape {faces.shape} is not (m, 3)", remedy)
        if faces.min() < 0 or faces.max() >= len(vertices):
            raise InputError("surface.faces", f"index {faces.max()} of {len(vertices)} vertices", remedy)
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", faces)
        open_edges = _unmatched_edges(faces)
        if open_edges:
            raise InputError("surface.faces", f"{open_edges} edges are open or run twice the same way", remedy)
        if self.volume <= 0:
            raise InputError("surface.faces", f"the volume is {self.volume:.4g}: they face inwards", "swap two columns")

    @property
    def corners(self) -> Float:
        """Corners of the triangles ``(m, 3, 3)``, mm: triangle, corner, x y z."""
        return self.vertices[self.faces]

    @property
    def volume(self) -> float:
        """Volume, mm³."""
        a, b, c = (self.corners - self.vertices[0]).transpose(1, 0, 2)
        return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)

    @property
    def area(self) -> float:
        """Area, mm²."""
        return float(np.linalg.norm(_cross(self), axis=1).sum() / 2)

    @property
    def normals(self) -> Float:
        """Outward unit normals of the triangles ``(m, 3)``; zero for triangles without area."""
        cross = _cross(self)
        length = np.linalg.norm(cross, axis=1, keepdims=True)
        return np.divide(cross, length, out=np.zeros_like(cross), where=length > 0)

    @property
    def euler_characteristic(self) -> int:
        """Vertices − edges + triangles: 2 for one body without holes through it, 0 with one hole, and so on."""
        return len(np.unique(self.faces)) - 3 * len(self.faces) // 2 + len(self.faces)

    def moved(self, matrix: Float, shift: Float) -> Surface:
        """Apply x → matrix · x + shift.

        Parameters
        ----------
        matrix : (3, 3) array
            A rotation, or another map that keeps the orientation.
        shift : (3,) array
            mm.

        Returns
        -------
        Surface
            The moved surface.
        """
        return Surface(self.vertices @ np.asarray(matrix).T + shift, self.faces)


def _cross(surface: Surface) -> Float:
    a, b, c = surface.corners.transpose(1, 0, 2)
    return np.cross(b - a, c - a)


def _unmatched_edges(faces: NDArray[np.int64]) -> int:
    """Directed edges that have no partner in the opposite direction, or more than one."""
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    n = int(faces.max()) + 1
    there, back = edges[:, 0] * n + edges[:, 1], edges[:, 1] * n + edges[:, 0]
    keys, counts = np.unique(there, return_counts=True)
    return int((counts > 1).sum() + (~np.isin(back, keys)).sum())


def largest_part(vertices: Float, faces: NDArray[np.int64]) -> tuple[Float, NDArray[np.int64], float]:
    """The connected part of the largest volume, and the volume of the other outer parts, over that of all.

    Surfaces of cavities face into the cavity: their volume is negative, and they are dropped.
    """
    n = len(vertices)
    pairs = faces[:, [0, 1, 1, 2]].reshape(-1, 2)
    graph = coo_array((np.ones(len(pairs), np.int8), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    _, part_of_vertex = connected_components(graph, directed=False)
    part = part_of_vertex[faces[:, 0]]
    a, b, c = (vertices[faces] - vertices.mean(axis=0)).transpose(1, 0, 2)
    volumes = np.bincount(part, np.einsum("ij,ij->i", a, np.cross(b, c)) / 6)
    largest = int(volumes.argmax())
    outer = volumes[volumes > 0].sum()
    kept = faces[part == largest]
    used, index = np.unique(kept, return_inverse=True)
    return vertices[used], index.reshape(-1, 3), float(1 - volumes[largest] / outer) if outer > 0 else 0.0


def subdivided(surface: Surface, longest: float) -> Surface:
    """The same surface in triangles whose edges are at most ``longest`` (mm), each triangle cut into four at a time."""
    vertices, faces = surface.vertices, surface.faces
    for _ in range(MAX_SUBDIVISIONS):
        a, b, c = vertices[faces].transpose(1, 0, 2)
        if max(np.linalg.norm(d, axis=1).max() for d in (b - a, c - b, a - c)) <= longest:
            break
        pairs = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        edges, index = np.unique(pairs, axis=0, return_inverse=True)
        ab, bc, ca = index.reshape(-1, 3).T + len(vertices)
        i, j, k = faces.T
        children = ([i, ab, ca], [j, bc, ab], [k, ca, bc], [ab, bc, ca])
        faces = np.concatenate([np.stack(child, axis=1) for child in children])
        vertices = np.concatenate([vertices, vertices[edges].mean(axis=1)])
    return Surface(vertices, faces)
