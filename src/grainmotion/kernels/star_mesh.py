# mypy: allow-untyped-defs
"""Kernels: point location in a star-shaped mesh.

A direction from the star point (the origin) lies in the cone of exactly one triangle.  The search starts at the
triangle that a coarse octahedral map stores for the direction, and steps to the neighbour across the edge that the
direction is outside of, until there is none.  The sign of the distance to that triangle's plane is exact: negative
inside the mesh.  Its size is nearly the distance to the surface, if that is small.
"""

from __future__ import annotations

import math

import numba

from grainmotion.kernels.compilation import CACHE

MAP_CELLS = 64  # cells along one side of the octahedral map


@numba.njit(cache=CACHE)
def cell(x, y, z):
    """Row and column of a direction in the octahedral map."""
    total = abs(x) + abs(y) + abs(z)
    if total == 0.0:
        return 0, 0
    a, b = x / total, y / total
    if z < 0.0:
        a, b = (1 - abs(b)) * (1.0 if a >= 0 else -1.0), (1 - abs(a)) * (1.0 if b >= 0 else -1.0)
    row, column = int((a + 1) / 2 * MAP_CELLS), int((b + 1) / 2 * MAP_CELLS)
    return min(max(row, 0), MAP_CELLS - 1), min(max(column, 0), MAP_CELLS - 1)


@numba.njit(cache=CACHE)
def _find_face(x, y, z, vertices, faces, across, face):
    """The triangle whose cone from the origin contains (x, y, z); the search starts at ``face``."""
    for _ in range(4 * MAP_CELLS + len(faces)):
        worst, edge = 0.0, -1
        for i in range(3):
            a, b = faces[face, i], faces[face, (i + 1) % 3]
            nx = vertices[a, 1] * vertices[b, 2] - vertices[a, 2] * vertices[b, 1]
            ny = vertices[a, 2] * vertices[b, 0] - vertices[a, 0] * vertices[b, 2]
            nz = vertices[a, 0] * vertices[b, 1] - vertices[a, 1] * vertices[b, 0]
            side = nx * x + ny * y + nz * z
            if side < 0.0:
                side /= math.sqrt(nx * nx + ny * ny + nz * nz)
            if side < worst:
                worst, edge = side, i
        if edge < 0:
            break
        face = across[face, edge]
    return face


@numba.njit(cache=CACHE)
def fill_map(vertices, faces, planes, across, start, reach):
    """Fill the map: triangle at each cell's centre, and largest radius at its corners, centre and vertices."""
    face = 0
    for i in range(MAP_CELLS):
        for k in range(MAP_CELLS):
            j = k if i % 2 == 0 else MAP_CELLS - 1 - k
            for corner in range(5):
                a = (i + (0.5 if corner == 4 else corner // 2)) / MAP_CELLS * 2 - 1
                b = (j + (0.5 if corner == 4 else corner % 2)) / MAP_CELLS * 2 - 1
                z = 1 - abs(a) - abs(b)
                if z < 0.0:
                    a, b = (1 - abs(b)) * (1.0 if a >= 0 else -1.0), (1 - abs(a)) * (1.0 if b >= 0 else -1.0)
                face = _find_face(a, b, z, vertices, faces, across, face)
                along = planes[face, 0] * a + planes[face, 1] * b + planes[face, 2] * z
                reach[i, j] = max(reach[i, j], planes[face, 3] / along * math.sqrt(a * a + b * b + z * z))
            start[i, j] = face
    for v in range(len(vertices)):
        x, y, z = vertices[v, 0], vertices[v, 1], vertices[v, 2]
        i, j = cell(x, y, z)
        reach[i, j] = max(reach[i, j], math.sqrt(x * x + y * y + z * z))


@numba.njit(cache=CACHE)
def distance(x, y, z, vertices, faces, planes, across, start):
    """Signed distance of a point to the plane of the triangle in its direction."""
    row, column = cell(x, y, z)
    f = _find_face(x, y, z, vertices, faces, across, start[row, column])
    return planes[f, 0] * x + planes[f, 1] * y + planes[f, 2] * z - planes[f, 3]


@numba.njit(cache=CACHE)
def distances(points, vertices, faces, planes, across, start, out):
    """Fill ``out`` (m) with `distance` of points (m, 3)."""
    for i in range(len(points)):
        out[i] = distance(points[i, 0], points[i, 1], points[i, 2], vertices, faces, planes, across, start)


@numba.njit(cache=CACHE)
def hits(directions, vertices, faces, planes, across, start, out):
    """Fill ``out`` (m, 3) with the surface points in directions (m, 3)."""
    for i in range(len(directions)):
        x, y, z = directions[i, 0], directions[i, 1], directions[i, 2]
        row, column = cell(x, y, z)
        f = _find_face(x, y, z, vertices, faces, across, start[row, column])
        scale = planes[f, 3] / (planes[f, 0] * x + planes[f, 1] * y + planes[f, 2] * z)
        out[i, 0], out[i, 1], out[i, 2] = x * scale, y * scale, z * scale
