"""Fracture: a particle split in two by a plane, exactly.

The plane passes through the point that the mesh is star-shaped about, so that the cut face is
star-shaped about the same point and a fan of triangles closes it; vertices on the cut are shared by both sides
of it.  The planes of all faces pass that point at a distance of at least d, so each point within d of
it sees the whole surface, and a point d/2 inside one half sees that whole half.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.simulate.sample import Particle
from grainmotion.simulate.shapes import Ellipsoid, Mesh, Shape, extent


@checked_arguments
def cut(mesh: Mesh, normal: ArrayLike) -> tuple[Mesh, Mesh]:
    """Cut a mesh in two by the plane through its star point.

    Parameters
    ----------
    mesh : Mesh
        Star-shaped about its ``star_point``.
    normal : (3,) array_like
        Normal of the plane, of any length.

    Returns
    -------
    (Mesh, Mesh)
        Closed meshes: the half that ``normal`` points to, and the other; their volumes add up to the mesh's.

    Raises
    ------
    InputError
        If the normal is zero or not finite.

    Examples
    --------
    >>> pieces = gm.simulate.cut(case.sample.particles[0].shape, np.array([0.0, 0, 1]))
    >>> len(pieces)
    2
    """
    n = np.asarray(normal, dtype=float)
    length = float(np.linalg.norm(n))
    if not (np.isfinite(length) and length > 0):
        raise InputError("cut", f"the normal {normal!r} has no direction", "give a vector that is not zero")
    n = n / length
    heights = (mesh.vertices - mesh.star_point) @ n
    heights[np.abs(heights) < 1e-12 * np.abs(heights).max()] = 0.0
    return _half(mesh, heights, n), _half(mesh, -heights, -n)


@checked_arguments
def broken(particle: Particle, normal: ArrayLike) -> tuple[Particle, Particle]:
    """Split a particle by the plane through the star point of its mesh; the halves stay in place.

    Parameters
    ----------
    particle : Particle
        Its shape must be a mesh.
    normal : (3,) array_like
        Normal of the plane, of any length.

    Returns
    -------
    (Particle, Particle)
        The half that ``normal`` points to, and the other, each with the inclusions that lie in it.

    Raises
    ------
    InputError
        If the particle is an ellipsoid, or the plane crosses an inclusion.

    Examples
    --------
    >>> halves = gm.simulate.broken(case.sample.particles[0], np.array([0.0, 0, 1]))
    >>> len(halves)
    2
    """
    mesh = particle.shape
    if isinstance(mesh, Ellipsoid):
        raise InputError("broken particle", "it is an ellipsoid", "give a mesh")
    n = np.asarray(normal, dtype=float)
    sides: tuple[list[tuple[Shape, float]], ...] = ([], [])
    for shape, value in particle.inclusions:
        low, high = (float(along[0] - n @ mesh.star_point) for along in extent(shape, n[None]))
        if low < 0 < high:
            raise InputError("broken particle", "the plane crosses an inclusion", "choose another plane")
        sides[0 if low >= 0 else 1].append((shape, value))
    first, second = cut(mesh, n)
    return (
        Particle(first, particle.attenuation, tuple(sides[0])),
        Particle(second, particle.attenuation, tuple(sides[1])),
    )


def _half(mesh: Mesh, heights: Float, normal: Float) -> Mesh:
    """The part of a mesh where its vertices' heights above the plane are > 0, with the cut face."""
    faces, above = mesh.faces, heights > 0
    count = above[faces].sum(axis=1)
    crossed = faces[(count == 1) | (count == 2)]
    one = above[crossed].sum(axis=1) == 1
    lone = np.where(one[:, None], above[crossed], ~above[crossed]).argmax(axis=1)
    # each crossed triangle from the vertex that is alone on its side, and where its two edges from there are cut
    apex, a, b = np.take_along_axis(crossed, (lone[:, None] + np.arange(3)) % 3, axis=1).T
    n = len(mesh.vertices)
    edges, index = np.unique(np.sort([[*apex, *apex], [*a, *b]], axis=0), axis=1, return_inverse=True)
    low, high = edges
    share = heights[low] / (heights[low] - heights[high])
    cuts = mesh.vertices[low] + share[:, None] * (mesh.vertices[high] - mesh.vertices[low])
    at = np.where(heights[low] == 0, low, np.where(heights[high] == 0, high, n + np.arange(len(cuts))))
    to_a, to_b = at[index.reshape(2, -1)]
    tip = above[apex]
    tips = np.stack([apex, to_a, to_b], axis=1)[tip]
    bases = np.concatenate([np.stack([to_a, a, b], axis=1), np.stack([to_a, b, to_b], axis=1)])[np.tile(~tip, 2)]
    rim = np.where(tip[:, None], np.stack([to_b, to_a], axis=1), np.stack([to_a, to_b], axis=1))
    cap = np.column_stack([rim, np.full(len(rim), n + len(cuts))])
    vertices = np.concatenate([mesh.vertices, cuts, mesh.star_point[None]])
    triangles = np.concatenate([faces[count == 3], tips, bases, cap])
    # where a vertex lies in the plane, some triangles have no area: two of their corners are the same
    triangles = triangles[(triangles != np.roll(triangles, 1, axis=1)).all(axis=1)]
    used, renamed = np.unique(triangles, return_inverse=True)
    return Mesh(vertices[used], renamed.reshape(-1, 3).astype(np.int64), mesh.star_point + mesh.depth / 2 * normal)
