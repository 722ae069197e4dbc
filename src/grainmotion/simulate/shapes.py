"""Exact shapes: triangle meshes that are star-shaped about a point, and ellipsoids.

`polyhedra` makes meshes of common shapes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.model.summary import Summarised

CUBE_CORNERS = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T


@dataclass(frozen=True, eq=False, repr=False)
class Mesh(Summarised):
    """A closed triangle mesh, star-shaped about one point; the solid *is* this mesh.

    Attributes
    ----------
    vertices : (m, 3) array
        mm, x y z.
    faces : (k, 3) int array
        Vertices of each triangle, counter-clockwise seen from outside.
    star_point : (3,) array
        A point inside from which the whole surface is visible, mm.

    Examples
    --------
    >>> ball = gm.simulate.sphere(2.0, 3)
    >>> round(ball.volume, 1)  # of radius 1
    4.2
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
        """Least distance from the star point to a face's plane, mm: any nearer point sees the whole surface, too."""
        return float(face_planes(self.vertices - self.star_point, self.faces)[:, 3].min())

    @property
    def clearance(self) -> float:
        """Least distance from the star point to the surface, mm: the radius of the largest ball about it."""
        corners = (self.vertices[self.faces] - self.star_point).transpose(1, 0, 2)
        planes = face_planes(self.vertices - self.star_point, self.faces)
        nearest, above_face = np.inf, np.ones(len(self.faces), dtype=bool)
        for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            edge = end - start
            along = np.clip(-(start * edge).sum(axis=1) / (edge**2).sum(axis=1), 0, 1)
            nearest = min(nearest, float(np.linalg.norm(start + along[:, None] * edge, axis=1).min()))
            above_face &= np.einsum("ij,ij->i", np.cross(start, edge), planes[:, :3]) >= 0
        return min(nearest, float(planes[above_face, 3].min(initial=np.inf)))

    @property
    def outline(self) -> Float:
        """Points whose convex hull holds the mesh ``(m, 3)``, mm: its vertices."""
        return self.vertices

    def moved(self, matrix: ArrayLike, shift: ArrayLike) -> Mesh:
        """Apply x → matrix · x + shift.

        Parameters
        ----------
        matrix, shift : (3, 3) and (3,) array_like
            A linear map that keeps the orientation, such as a scale, and a translation, mm.

        Returns
        -------
        Mesh
            The transformed mesh.
        """
        m, s = np.asarray(matrix, dtype=float), np.asarray(shift, dtype=float)
        return Mesh(self.vertices @ m.T + s, self.faces, m @ self.star_point + s)


@dataclass(frozen=True, eq=False, repr=False)
class Ellipsoid(Summarised):
    """A solid ellipsoid.

    Attributes
    ----------
    center : (3,) array
        mm, x y z.
    semi_axes : (3,) array
        mm.
    axes : (3, 3) array
        Unit vectors of the semi-axes, in columns.

    Examples
    --------
    >>> ball = gm.simulate.Ellipsoid(np.zeros(3), np.ones(3), np.eye(3))
    >>> gm.simulate.inside(ball, np.array([[0.0, 0, 0.9], [0, 0, 1.1]])).tolist()
    [True, False]
    """

    center: Float
    semi_axes: Float
    axes: Float

    def __post_init__(self) -> None:
        if np.shape(self.semi_axes) != (3,) or not np.all(np.asarray(self.semi_axes) > 0):
            raise InputError("ellipsoid", f"semi-axes {self.semi_axes}", "give three lengths > 0, mm")

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

    @property
    def outline(self) -> Float:
        """Points whose convex hull holds the ellipsoid ``(8, 3)``, mm: corners of the box around it."""
        return self.center + (CUBE_CORNERS * self.semi_axes) @ self.axes.T

    def moved(self, matrix: ArrayLike, shift: ArrayLike) -> Ellipsoid:
        """Apply x → matrix · x + shift.

        Parameters
        ----------
        matrix, shift : (3, 3) and (3,) array_like
            A rotation times a scale, and a translation, mm.

        Returns
        -------
        Ellipsoid
            The transformed ellipsoid.
        """
        m, s = np.asarray(matrix, dtype=float), np.asarray(shift, dtype=float)
        scale = np.cbrt(np.linalg.det(m))
        return Ellipsoid(m @ self.center + s, scale * self.semi_axes, m @ self.axes / scale)


Shape = Mesh | Ellipsoid


def extent(shape: Shape, directions: ArrayLike) -> tuple[Float, Float]:
    """Least and greatest x · direction over a shape, mm, ``(k,)`` each, for unit ``directions (k, 3)``."""
    d = np.asarray(directions, dtype=float)
    if isinstance(shape, Mesh):
        along = shape.vertices @ d.T
        return along.min(axis=0), along.max(axis=0)
    half, middle = np.linalg.norm((d @ shape.axes) * shape.semi_axes, axis=1), d @ shape.center
    return middle - half, middle + half


def _tetrahedra(mesh: Mesh) -> tuple[Float, Float]:
    """Signed volumes ``(k,)`` and centroids ``(k, 3)`` of the tetrahedra star point – face."""
    corners = mesh.vertices[mesh.faces] - mesh.star_point
    volumes = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    return volumes, mesh.star_point + corners.sum(axis=1) / 4


def face_planes(vertices: Float, faces: NDArray[np.integer]) -> Float:
    """Outward unit normal of each face's plane and its distance from the origin ``(k, 4)``."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return np.concatenate([normals, np.einsum("ij,ij->i", normals, a)[:, None]], axis=1)
