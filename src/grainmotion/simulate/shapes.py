"""Shapes without voxels: triangle meshes that are star-shaped about a point, and ellipsoids."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import ConvexHull
from scipy.special import sph_harm_y

from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.simulate.stone_shapes import read_stone_shapes


@dataclass(frozen=True, eq=False)
class Mesh:
    """A closed triangle mesh, star-shaped about one point; the solid *is* this mesh.

    Attributes
    ----------
    vertices : (m, 3) array
        mm, x y z.
    faces : (k, 3) int array
        Vertices of each triangle, counter-clockwise seen from outside.
    star_point : (3,) array
        A point inside from which the whole surface is seen, mm.
    """

    vertices: Float
    faces: NDArray[np.int64]
    star_point: Float

    @property
    def volume(self) -> float:
        """Volume, mm³."""
        return float(_tetrahedra(self)[0].sum())

    @property
    def centroid(self) -> Float:
        """Centre of the volume ``(3,)``, mm."""
        volumes, centres = _tetrahedra(self)
        return volumes @ centres / volumes.sum()

    @property
    def depth(self) -> float:
        """Least distance from the star point to a face's plane, mm: all points that near see the whole surface."""
        corners, normals = _corners(self)
        return float(np.einsum("ij,ij->i", corners[0], normals).min())

    @property
    def clearance(self) -> float:
        """Least distance from the star point to the surface, mm: the radius of the largest ball about it."""
        corners, normals = _corners(self)
        nearest, over = np.inf, np.ones(len(self.faces), dtype=bool)
        for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            edge = end - start
            along = np.clip(-(start * edge).sum(axis=1) / (edge**2).sum(axis=1), 0, 1)
            nearest = min(nearest, float(np.linalg.norm(start + along[:, None] * edge, axis=1).min()))
            over &= np.einsum("ij,ij->i", np.cross(start, edge), normals) >= 0
        heights = np.einsum("ij,ij->i", corners[0], normals)[over]
        return min(nearest, float(heights.min(initial=np.inf)))

    def moved(self, matrix: ArrayLike, shift: ArrayLike) -> Mesh:
        """The mesh carried by x → matrix · x + shift (``matrix`` may also scale)."""
        m, s = np.asarray(matrix, dtype=float), np.asarray(shift, dtype=float)
        return Mesh(self.vertices @ m.T + s, self.faces, m @ self.star_point + s)


@dataclass(frozen=True, eq=False)
class Ellipsoid:
    """A solid ellipsoid.

    Attributes
    ----------
    center : (3,) array
        mm, x y z.
    semi_axes : (3,) array
        mm.
    axes : (3, 3) array
        Unit vectors of the semi-axes, in columns.
    """

    center: Float
    semi_axes: Float
    axes: Float

    @property
    def volume(self) -> float:
        """Volume, mm³."""
        return float(4 / 3 * np.pi * np.prod(self.semi_axes))

    @property
    def centroid(self) -> Float:
        """Centre ``(3,)``, mm."""
        return self.center

    @property
    def whitening(self) -> Float:
        """The matrix M ``(3, 3)`` with ‖M (x − center)‖ ≤ 1 inside, 1/mm."""
        return (self.axes / self.semi_axes).T

    def moved(self, matrix: ArrayLike, shift: ArrayLike) -> Ellipsoid:
        """The ellipsoid carried by x → matrix · x + shift, where ``matrix`` is a rotation times a scale."""
        m, s = np.asarray(matrix, dtype=float), np.asarray(shift, dtype=float)
        scale = np.cbrt(np.linalg.det(m))
        return Ellipsoid(m @ self.center + s, scale * self.semi_axes, m @ self.axes / scale)


Shape = Mesh | Ellipsoid


@lru_cache(maxsize=8)
def icosphere(level: int) -> tuple[Float, NDArray[np.int64]]:
    """Unit directions ``(10·4^level + 2, 3)`` and triangles ``(20·4^level, 3)`` of a subdivided icosahedron.

    The directions of a lower level come first, so that ``directions[:642]`` is level 3.
    """
    if not 0 <= level <= 8:
        raise InputError("icosphere level", f"must be 0 to 8, got {level}", "4 or 5 is fine enough for a stone")
    if level == 0:
        g = (1 + 5**0.5) / 2
        base = np.array([[-1, g, 0], [1, g, 0], [-1, -g, 0], [1, -g, 0]])
        vertices = np.concatenate([base, np.roll(base, 1, axis=1), np.roll(base, 2, axis=1)])
        faces = ConvexHull(vertices).simplices.astype(np.int64)
        faces = _outward(vertices, faces)
    else:
        vertices, coarse = icosphere(level - 1)
        pairs = np.sort(coarse[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        edges, index = np.unique(pairs, axis=0, return_inverse=True)
        middle = index.reshape(-1, 3) + len(vertices)
        a, b, c = coarse.T
        ab, bc, ca = middle.T
        children = [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]
        faces = np.concatenate([np.stack(child, axis=1) for child in children])
        vertices = np.concatenate([vertices, vertices[edges].mean(axis=1)])
    vertices = vertices / np.linalg.norm(vertices, axis=1, keepdims=True)
    vertices.setflags(write=False)
    faces.setflags(write=False)
    return vertices, faces


def stone_radius(stone: int, directions: ArrayLike) -> Float:
    """Radius r(θ, φ) of one FDOT-57 stone along unit directions ``(m, 3)``, mm, ``(m,)``."""
    return _basis(np.asarray(directions, dtype=float)) @ _real_coefficients(stone)


def stone(index: int, diameter: float | None = None, level: int = 4) -> Mesh:
    """A real gravel stone about its own centre of mass.

    Parameters
    ----------
    index : int
        0 to 94: which of the FDOT-57 stones (see `grainmotion.simulate.stone_shapes`).
    diameter : float, optional
        Diameter of the sphere of the same volume, mm; the stone's own size (12–20 mm) if None.
    level : int
        Subdivisions of the icosahedron that carries it: 4 gives 5,120 triangles, 5 gives 20,480.
    """
    directions, faces = icosphere(level)
    mesh = Mesh((_level_basis(level) @ _real_coefficients(index))[:, None] * directions, faces, np.zeros(3))
    mesh = mesh.moved(np.eye(3), -mesh.centroid)
    return mesh if diameter is None else _resized(mesh, diameter)


def sphere(diameter: float, level: int = 4) -> Mesh:
    """A triangulated sphere at the origin whose *vertices* lie on the sphere."""
    directions, faces = icosphere(level)
    return Mesh(directions * diameter / 2, faces, np.zeros(3))


def polyhedron(points: ArrayLike) -> Mesh:
    """The convex polyhedron spanned by points ``(m, 3)``, mm."""
    points = np.asarray(points, dtype=float)
    hull = ConvexHull(points)
    keep = np.unique(hull.simplices)
    rename = np.full(len(points), -1)
    rename[keep] = np.arange(len(keep))
    vertices = points[keep]
    inner = vertices.mean(axis=0)
    return Mesh(vertices, _outward(vertices - inner, rename[hull.simplices].astype(np.int64)), inner)


def random_polyhedron(rng: np.random.Generator, diameter: float, corners: int = 16) -> Mesh:
    """A convex polyhedron with random corners on a mild ellipsoid, about its centre of mass.

    ``diameter`` (mm) is that of the sphere of the same volume.
    """
    if corners < 6:
        raise InputError("corners", f"must be >= 6, got {corners}", "ask for more corners")
    start, _ = icosphere(1)
    spread = start[rng.choice(len(start), min(corners, len(start)), replace=False)]
    extra = rng.normal(size=(max(0, corners - len(start)), 3))
    directions = np.concatenate([spread + 0.25 * rng.normal(size=spread.shape), extra])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    mesh = polyhedron(directions * rng.uniform(0.8, 1.25, 3))
    mesh = mesh.moved(np.eye(3), -mesh.centroid)
    return _resized(Mesh(mesh.vertices, mesh.faces, np.zeros(3)), diameter)


# ---------------------------------------------------------------------- helpers
def _resized(mesh: Mesh, diameter: float) -> Mesh:
    if not diameter > 0:
        raise InputError("diameter", f"must be > 0, got {diameter}", "give it in mm")
    return mesh.moved(np.eye(3) * diameter / np.cbrt(6 * mesh.volume / np.pi), np.zeros(3))


def _tetrahedra(mesh: Mesh) -> tuple[Float, Float]:
    """Signed volumes ``(k,)`` and centroids ``(k, 3)`` of the tetrahedra star point – face."""
    corners = mesh.vertices[mesh.faces] - mesh.star_point
    volumes = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    return volumes, mesh.star_point + corners.sum(axis=1) / 4


def _corners(mesh: Mesh) -> tuple[Float, Float]:
    """Corners of the faces seen from the star point ``(3, k, 3)``, and outward unit normals ``(k, 3)``."""
    corners = (mesh.vertices[mesh.faces] - mesh.star_point).transpose(1, 0, 2)
    normals = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    return corners, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def _outward(vertices: Float, faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Turn triangles around the origin so that they are counter-clockwise seen from outside."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    inward = np.einsum("ij,ij->i", a, np.cross(b, c)) < 0
    return np.where(inward[:, None], faces[:, ::-1], faces)


def _basis(directions: Float) -> Float:
    """Real design matrix ``(m, 2·378)``: Re and −Im of the stored harmonics, m > 0 counted twice."""
    shapes = read_stone_shapes()
    theta = np.arccos(np.clip(directions[:, 2], -1, 1))
    phi = np.arctan2(directions[:, 1], directions[:, 0])
    twice = np.where(shapes.orders > 0, 2.0, 1.0)
    y = sph_harm_y(shapes.degrees, shapes.orders, theta[:, None], phi[:, None]) * twice
    return np.concatenate([y.real, -y.imag], axis=1)


@lru_cache(maxsize=3)
def _level_basis(level: int) -> NDArray[np.float32]:
    return _basis(icosphere(level)[0]).astype(np.float32)


def _real_coefficients(index: int) -> Float:
    shapes = read_stone_shapes()
    if not 0 <= index < len(shapes):
        raise InputError("stone", f"index {index} is not 0 to {len(shapes) - 1}", "choose one of the shapes")
    a = shapes.coefficients[index]
    return np.concatenate([a.real, a.imag])
