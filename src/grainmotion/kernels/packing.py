# mypy: allow-untyped-defs
"""Kernels of the packing: overlap tests, falling and settling.

Two bodies overlap where a surface point (probe) of one lies inside the other.  Most probes are excluded in clusters
by bounding spheres, most others by a map of the largest radius in each direction.  Probes that blocked recent moves
are tested first, since they block most of the next ones too.

The records ``bodies``, ``poses`` and ``rules`` are those of `simulate.packing_arrays`.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from grainmotion.kernels.compilation import CACHE
from grainmotion.kernels.star_mesh import cell, distance

REMEMBERED_PROBES = 8  # number of recent blocking probes that are tested first


# ---------------------------------------------------------------------- overlap
@numba.njit(cache=CACHE)
def rotation_of(w):
    """Rotation matrix of a rotation vector (Rodrigues)."""
    angle = math.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
    out = np.eye(3)
    if angle > 0.0:
        sine, versine = math.sin(angle) / angle, (1.0 - math.cos(angle)) / (angle * angle)
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            out[i, i] -= versine * (w[j] * w[j] + w[k] * w[k])
            out[j, i] = versine * w[i] * w[j] + sine * w[k]
            out[k, i] = versine * w[i] * w[k] - sine * w[j]
    return out


@numba.njit(cache=CACHE)
def _product(a, b):
    """The matrix product a b (3, 3)."""
    out = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                out[i, j] += a[i, k] * b[k, j]
    return out


@numba.njit(cache=CACHE)
def _transformed(t, x, p):
    """The point t p + x."""
    return (
        t[0, 0] * p[0] + t[0, 1] * p[1] + t[0, 2] * p[2] + x[0],
        t[1, 0] * p[0] + t[1, 1] * p[1] + t[1, 2] * p[2] + x[1],
        t[2, 0] * p[0] + t[2, 1] * p[1] + t[2, 2] * p[2] + x[2],
    )


@numba.njit(cache=CACHE)
def _relative(xi, ti, xj, tj):
    """The pose of frame i in frame j."""
    s, m = np.zeros(3), np.zeros((3, 3))
    for a in range(3):
        for k in range(3):
            s[a] += tj[k, a] * (xi[k] - xj[k])
            for b in range(3):
                m[a, b] += tj[k, a] * ti[k, b]
    return s, m


@numba.njit(cache=CACHE)
def _distance_between(a, b):
    """Distance between two points."""
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@numba.njit(cache=CACHE)
def _probe_distance(x, y, z, j, reach, bodies):
    """Signed distance of a point in body j's frame to its surface; infinite if certainly beyond ``reach``."""
    far = math.sqrt(x * x + y * y + z * z)
    row, column = cell(x, y, z)
    if far > bodies.reaches[j, row, column] + reach:
        return np.inf
    return distance(x, y, z, bodies.vertices, bodies.faces, bodies.planes, bodies.across, bodies.starts[j])


@numba.njit(cache=CACHE)
def nearest(i, j, xi, ti, xj, tj, first, last, stop, reach, bodies):
    """Least signed distance of probes of body i (clusters ``first`` to ``last``) to body j, and that probe's index.

    Probes further than ``reach`` from the surface may be skipped; the search ends at the first distance below ``stop``.
    """
    best, which = np.inf, -1
    s, m = _relative(xi, ti, xj, tj)
    limit = bodies.radii[j] + reach
    for c in range(bodies.first[i] + first, bodies.first[i] + last):
        p = bodies.clusters[c]
        x, y, z = _transformed(m, s, p)
        if x * x + y * y + z * z > (limit + p[3]) ** 2:
            continue
        for k in range(bodies.ends[c - 1] if c > 0 else 0, bodies.ends[c]):
            x, y, z = _transformed(m, s, bodies.probes[k])
            d = _probe_distance(x, y, z, j, reach, bodies)
            if d < best:
                best, which = d, k
                if best < stop:
                    return best, which
    return best, which


@numba.njit(cache=CACHE)
def _inside_cylinder(i, x, t, first, last, bodies, rules):
    """Whether probes of body i (clusters ``first`` to ``last``) are above the floor and within the wall."""
    for c in range(bodies.first[i] + first, bodies.first[i] + last):
        p = bodies.clusters[c]
        a, b, z = _transformed(t, x, p)
        if z > p[3] and math.hypot(a, b) + p[3] < rules.radius:
            continue
        for k in range(bodies.ends[c - 1] if c > 0 else 0, bodies.ends[c]):
            a, b, z = _transformed(t, x, bodies.probes[k])
            if z < 0.0 or a * a + b * b > rules.radius * rules.radius:
                return False
    return True


@numba.njit(cache=CACHE)
def _cluster_range(i, fine, bodies):
    """Range of body i's clusters: those of its coarse probes, or (``fine``) the others."""
    return (bodies.coarse[i], bodies.first[i + 1] - bodies.first[i]) if fine else (0, bodies.coarse[i])


@numba.njit(cache=CACHE)
def _free(i, count, x, t, poses, bodies, rules, blockers):
    """Whether body i at (x, t) keeps the gap to the first ``count`` bodies and is above the floor and within the wall.

    ``blockers`` (REMEMBERED_PROBES, 3) are the recent blocking probes: 0 if the probe is of body i or 1 if it is of the
    other body, the other body, the probe; the first column is -1 in unused rows.
    """
    reach = 3.0 * rules.gap
    for r in range(REMEMBERED_PROBES):
        side, j, k = blockers[r, 0], blockers[r, 1], blockers[r, 2]
        if side < 0:
            break
        xj, tj = poses.positions[j], poses.rotations[j]
        s, m = _relative(x, t, xj, tj) if side == 0 else _relative(xj, tj, x, t)
        a, b, c = _transformed(m, s, bodies.probes[k])
        if _probe_distance(a, b, c, j if side == 0 else i, reach, bodies) < rules.gap:
            return False
    for fine in range(2):
        first, last = _cluster_range(i, fine, bodies)
        if not _inside_cylinder(i, x, t, first, last, bodies, rules):
            return False
        for j in range(count):
            if j == i or _distance_between(x, poses.positions[j]) > bodies.radii[i] + bodies.radii[j] + rules.gap:
                continue
            for side in range(2):
                a, b = (i, j) if side == 0 else (j, i)
                xa, ta = (x, t) if side == 0 else (poses.positions[j], poses.rotations[j])
                xb, tb = (poses.positions[j], poses.rotations[j]) if side == 0 else (x, t)
                first, last = _cluster_range(a, fine, bodies)
                best, which = nearest(a, b, xa, ta, xb, tb, first, last, rules.gap, reach, bodies)
                if best < rules.gap:
                    for r in range(REMEMBERED_PROBES - 1, 0, -1):
                        for i3 in range(3):
                            blockers[r, i3] = blockers[r - 1, i3]
                    blockers[0, 0], blockers[0, 1], blockers[0, 2] = side, j, which
                    return False
    return True


# ---------------------------------------------------------------------- motion
@numba.njit(cache=CACHE)
def _set_pose(i, x, t, poses):
    """Write the pose (x, t) of body i."""
    for a in range(3):
        poses.positions[i, a] = x[a]
        for b in range(3):
            poses.rotations[i, a, b] = t[a, b]


@numba.njit(cache=CACHE)
def fall(i, count, x, t, poses, bodies, rules):
    """Height at which body i, falling from (x, t), touches one of the first ``count`` bodies or the floor."""
    blockers = np.full((REMEMBERED_PROBES, 3), -1)
    x = x.copy()
    step = 0.1 * rules.size
    while step > 1e-4 * rules.size:
        x[2] -= step
        if not _free(i, count, x, t, poses, bodies, rules, blockers):
            x[2] += step
            step *= 0.5
    return x[2]


@numba.njit(cache=CACHE)
def drop(i, poses, bodies, rules, drops, rng):
    """Let body i fall on bodies 0 to i - 1 from random poses, and keep the lowest final pose."""
    top = bodies.radii[i] + 2.0 * rules.gap
    for j in range(i):
        top = max(top, poses.positions[j, 2] + bodies.radii[j] + bodies.radii[i] + 2.0 * rules.gap)
    lowest = np.inf
    for _ in range(drops):
        t = rotation_of(rng.normal(0.0, 3.0, 3))
        distance_from_axis = (rules.radius - bodies.radii[i]) * math.sqrt(rng.random())
        angle = 2.0 * math.pi * rng.random()
        x = np.array([distance_from_axis * math.cos(angle), distance_from_axis * math.sin(angle), top])
        x[2] = fall(i, i, x, t, poses, bodies, rules)
        if x[2] < lowest:
            lowest = x[2]
            _set_pose(i, x, t, poses)


@numba.njit(cache=CACHE)
def settle(i, count, poses, bodies, rules, moves, rng):
    """Lower body i among the first ``count`` bodies by small random moves."""
    step = 0.1
    blockers = np.full((REMEMBERED_PROBES, 3), -1)
    for _ in range(moves):
        shift = rng.normal(0.0, step * rules.size, 3)
        shift[2] = -abs(shift[2]) if rng.random() < 0.8 else -0.05 * step * rules.size
        spin = rng.normal(0.0, 2.0 * step, 3) if rng.random() < 0.7 else np.zeros(3)
        x, t = poses.positions[i] + shift, _product(rotation_of(spin), poses.rotations[i])
        if _free(i, count, x, t, poses, bodies, rules, blockers):
            _set_pose(i, x, t, poses)
            step = min(0.2, step * 1.6)
        else:
            step *= 0.97
        if step < 2e-4:
            break


@numba.njit(cache=CACHE)
def all_gaps(poses, bodies, reach, out):
    """Fill ``out`` (n, n) with the least signed distance of body i's probes to body j, up to ``reach``."""
    x, t = poses.positions, poses.rotations
    for i in range(len(x)):
        for j in range(len(x)):
            if i != j and _distance_between(x[i], x[j]) < bodies.radii[i] + bodies.radii[j] + reach:
                last = bodies.first[i + 1] - bodies.first[i]
                out[i, j] = nearest(i, j, x[i], t[i], x[j], t[j], 0, last, -np.inf, reach, bodies)[0]
