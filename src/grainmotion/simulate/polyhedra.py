"""Meshes of common shapes: spheres, convex hulls, discs and random stones."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import ConvexHull, QhullError

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.simulate.shapes import Mesh


@lru_cache(maxsize=8)
def icosphere(level: int) -> tuple[Float, NDArray[np.int64]]:
    """A subdivided icosahedron.

    Parameters
    ----------
    level : int
        Number of subdivisions, 0 to 8.

    Returns
    -------
    directions : (10·4^level + 2, 3) array
        Unit vectors.  Those of a lower level come first, so that ``directions[:642]`` is level 3.
    faces : (20·4^level, 3) int array
        Triangles, counter-clockwise seen from outside.

    Raises
    ------
    InputError
        If the level is out of range.

    Examples
    --------
    >>> vertices, faces = gm.simulate.icosphere(1)
    >>> len(vertices), len(faces)
    (42, 80)
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


@checked_arguments
def sphere(diameter: float, level: int = 4) -> Mesh:
    """A triangulated sphere at the origin.

    Parameters
    ----------
    diameter : float
        Diameter of the sphere that the vertices lie on, mm.
    level : int
        Subdivisions of the icosahedron, see `icosphere`.

    Returns
    -------
    Mesh
        The inscribed polyhedron.

    Raises
    ------
    InputError
        If the diameter is not above 0, or the level is out of range.

    Examples
    --------
    >>> round(gm.simulate.sphere(2.0, 4).volume, 2)  # a little less than 4/3 π
    4.18
    """
    if not diameter > 0:
        raise InputError("diameter", f"must be > 0, got {diameter}", "give it in mm")
    directions, faces = icosphere(level)
    return Mesh(directions * diameter / 2, faces, np.zeros(3))


@checked_arguments
def polyhedron(points: ArrayLike) -> Mesh:
    """The convex hull of points.

    Parameters
    ----------
    points : (m, 3) array_like
        mm, not all in one plane.

    Returns
    -------
    Mesh
        The hull; points inside it are dropped.

    Raises
    ------
    InputError
        If the points lie in one plane, or are not ``(m, 3)``.

    Examples
    --------
    >>> cube = gm.simulate.polyhedron(np.array([[x, y, z] for x in (0.0, 1) for y in (0, 1) for z in (0, 1)]))
    >>> round(cube.volume, 6)
    1.0
    """
    points = np.asarray(points, dtype=float)
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError) as error:
        raise InputError(
            "polyhedron", f"its {len(points)} points span no volume", "give (m, 3), mm, not all in one plane"
        ) from error
    keep = np.unique(hull.simplices)
    rename = np.full(len(points), -1)
    rename[keep] = np.arange(len(keep))
    vertices = points[keep]
    inner = vertices.mean(axis=0)
    return Mesh(vertices, _outward(vertices - inner, rename[hull.simplices].astype(np.int64)), inner)


@checked_arguments
def disc(radius: float, bottom: float, top: float, corners: int = 48) -> Mesh:
    """An upright prism about the z axis that is nearly a cylinder, such as a piston.

    Parameters
    ----------
    radius : float
        Of the circle through its corners, mm.
    bottom, top : float
        Heights of its ends, mm.
    corners : int
        Number of its sides; 48 are within 0.2 % of the radius.

    Returns
    -------
    Mesh
        The prism.

    Raises
    ------
    InputError
        If the radius is not above 0, its top is not above its bottom, or it has fewer than three sides.

    Examples
    --------
    >>> round(gm.simulate.disc(2.0, 0.0, 0.5).volume, 1)
    6.3
    """
    if not (radius > 0 and top > bottom and corners >= 3):
        fact = f"radius {radius}, from {bottom} to {top} mm, {corners} sides"
        raise InputError("disc", fact, "give a radius > 0, the bottom below the top, and 3 sides or more")
    angles = np.arange(corners) * 2 * np.pi / corners
    ring = radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return polyhedron(np.concatenate([np.column_stack([ring, np.full(corners, z)]) for z in (bottom, top)]))


@checked_arguments
def random_polyhedron(rng: np.random.Generator, diameter: float, corners: int = 16) -> Mesh:
    """A convex polyhedron with random corners on an ellipsoid of moderate aspect ratio.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of the shape.
    diameter : float
        Diameter of the sphere of the same volume, mm.
    corners : int
        Number of random points, at least 6; the hull may have fewer corners.

    Returns
    -------
    Mesh
        The polyhedron, its centre of mass at the origin.

    Raises
    ------
    InputError
        If there are fewer than 6 corners, or the diameter is not positive.

    Examples
    --------
    >>> stone = gm.simulate.random_polyhedron(np.random.default_rng(0), 2.0)
    >>> stone.vertices.shape[1]
    3
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
    return resized(Mesh(mesh.vertices, mesh.faces, np.zeros(3)), diameter)


def resized(mesh: Mesh, diameter: float) -> Mesh:
    """A mesh scaled about the origin to the volume of a sphere of ``diameter``, mm."""
    if not diameter > 0:
        raise InputError("diameter", f"must be > 0, got {diameter}", "give it in mm")
    return mesh.moved(np.eye(3) * diameter / np.cbrt(6 * mesh.volume / np.pi), np.zeros(3))


def _outward(vertices: Float, faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Reorder triangles around the origin so that they are counter-clockwise seen from outside."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    inward = np.einsum("ij,ij->i", a, np.cross(b, c)) < 0
    return np.where(inward[:, None], faces[:, ::-1], faces)
