# mypy: allow-untyped-defs
"""Kernels of the packing: overlap, falling and settling.

Two bodies overlap where a surface point (probe) of one lies inside the other.  Most probes are ruled
out in clusters by bounding spheres, most others by a map of the radius against the direction; the
probes that blocked the last moves are tried first, since they will block most of the next.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from grainmotion.kernels.compilation import CACHE
from grainmotion.kernels.star_mesh import cell, distance

REMEMBERED = 8  # probes that blocked the last moves


# ---------------------------------------------------------------------- overlap
@numba.njit(cache=CACHE)
def turn_matrix(w):
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
def _times(a, b):
    out = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                out[i, j] += a[i, k] * b[k, j]
    return out


@numba.njit(cache=CACHE)
def _carried(t, x, p):
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
def _apart(a, b):
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@numba.njit(cache=CACHE)
def _probe_distance(x, y, z, j, reach, bodies):
    """Signed distance of a point in body j's frame to its surface; infinite if surely beyond ``reach``."""
    far = math.sqrt(x * x + y * y + z * z)
    row, column = cell(x, y, z)
    if far > bodies.reaches[j, row, column] + reach:
        return np.inf
    return distance(
        x, y, z, bodies.vertices, bodies.faces, bodies.planes, bodies.across, bodies.starts[j]
    )  # fmt: skip


@numba.njit(cache=CACHE)
def nearest(i, j, xi, ti, xj, tj, first, last, stop, reach, bodies):
    """Least signed distance of probes of body i (clusters ``first`` to ``last``) to body j, and the probe.

    Probes further than ``reach`` from the surface may be passed over; ends early once below ``stop``.
    """
    best, which = np.inf, -1
    s, m = _relative(xi, ti, xj, tj)
    limit = bodies.radii[j] + reach
    for c in range(bodies.first[i] + first, bodies.first[i] + last):
        p = bodies.clusters[c]
        x, y, z = _carried(m, s, p)
        if x * x + y * y + z * z > (limit + p[3]) ** 2:
            continue
        for k in range(bodies.ends[c - 1] if c > 0 else 0, bodies.ends[c]):
            x, y, z = _carried(m, s, bodies.probes[k])
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
        a, b, z = _carried(t, x, p)
        if z > p[3] and math.hypot(a, b) + p[3] < rules.radius:
            continue
        for k in range(bodies.ends[c - 1] if c > 0 else 0, bodies.ends[c]):
            a, b, z = _carried(t, x, bodies.probes[k])
            if z < 0.0 or a * a + b * b > rules.radius * rules.radius:
                return False
    return True


@numba.njit(cache=CACHE)
def _stage(i, fine, bodies):
    """First and last cluster of body i: its coarse probes, or the others."""
    return (bodies.coarse[i], bodies.first[i + 1] - bodies.first[i]) if fine else (0, bodies.coarse[i])


@numba.njit(cache=CACHE)
def _free(i, count, x, t, poses, bodies, rules, blockers):
    """Whether body i at (x, t) keeps the gap to the first ``count`` bodies, the floor z = 0 and the wall."""
    reach = 3.0 * rules.gap
    for r in range(REMEMBERED):
        side, j, k = blockers[r, 0], blockers[r, 1], blockers[r, 2]
        if side < 0:
            break
        xj, tj = poses.positions[j], poses.turns[j]
        s, m = _relative(x, t, xj, tj) if side == 0 else _relative(xj, tj, x, t)
        a, b, c = _carried(m, s, bodies.probes[k])
        if _probe_distance(a, b, c, j if side == 0 else i, reach, bodies) < rules.gap:
            return False
    for fine in range(2):
        first, last = _stage(i, fine, bodies)
        if not _inside_cylinder(i, x, t, first, last, bodies, rules):
            return False
        for j in range(count):
            if j == i or _apart(x, poses.positions[j]) > bodies.radii[i] + bodies.radii[j] + rules.gap:
                continue
            for side in range(2):
                a, b = (i, j) if side == 0 else (j, i)
                xa, ta = (x, t) if side == 0 else (poses.positions[j], poses.turns[j])
                xb, tb = (poses.positions[j], poses.turns[j]) if side == 0 else (x, t)
                first, last = _stage(a, fine, bodies)
                best, which = nearest(a, b, xa, ta, xb, tb, first, last, rules.gap, reach, bodies)
                if best < rules.gap:
                    for r in range(REMEMBERED - 1, 0, -1):
                        for i3 in range(3):
                            blockers[r, i3] = blockers[r - 1, i3]
                    blockers[0, 0], blockers[0, 1], blockers[0, 2] = side, j, which
                    return False
    return True


# ---------------------------------------------------------------------- motion
@numba.njit(cache=CACHE)
def _place(i, x, t, poses):
    for a in range(3):
        poses.positions[i, a] = x[a]
        for b in range(3):
            poses.turns[i, a, b] = t[a, b]


@numba.njit(cache=CACHE)
def fall(i, count, x, t, poses, bodies, rules):
    """Height at which body i, falling from (x, t), meets the first of ``count`` bodies or the floor."""
    blockers = np.full((REMEMBERED, 3), -1)
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
    """Let body i fall on those before it from random poses, and leave it at the lowest."""
    top = bodies.radii[i] + 2.0 * rules.gap
    for j in range(i):
        top = max(top, poses.positions[j, 2] + bodies.radii[j] + bodies.radii[i] + 2.0 * rules.gap)
    lowest = np.inf
    for _ in range(drops):
        t = turn_matrix(rng.normal(0.0, 3.0, 3))
        room = (rules.radius - bodies.radii[i]) * math.sqrt(rng.random())
        angle = 2.0 * math.pi * rng.random()
        x = np.array([room * math.cos(angle), room * math.sin(angle), top])
        x[2] = fall(i, i, x, t, poses, bodies, rules)
        if x[2] < lowest:
            lowest = x[2]
            _place(i, x, t, poses)


@numba.njit(cache=CACHE)
def settle(i, count, poses, bodies, rules, moves, rng):
    """Small random moves that lower body i among the first ``count`` bodies."""
    step = 0.1
    blockers = np.full((REMEMBERED, 3), -1)
    for _ in range(moves):
        shift = rng.normal(0.0, step * rules.size, 3)
        shift[2] = -abs(shift[2]) if rng.random() < 0.8 else -0.05 * step * rules.size
        spin = rng.normal(0.0, 2.0 * step, 3) if rng.random() < 0.7 else np.zeros(3)
        x, t = poses.positions[i] + shift, _times(turn_matrix(spin), poses.turns[i])
        if _free(i, count, x, t, poses, bodies, rules, blockers):
            _place(i, x, t, poses)
            step = min(0.2, step * 1.6)
        else:
            step *= 0.97
        if step < 2e-4:
            break


@numba.njit(cache=CACHE)
def all_gaps(poses, bodies, reach, out):
    """Fill ``out`` (n, n) with the least signed distance of body i's probes to body j, up to ``reach``."""
    x, t = poses.positions, poses.turns
    for i in range(len(x)):
        for j in range(len(x)):
            if i != j and _apart(x[i], x[j]) < bodies.radii[i] + bodies.radii[j] + reach:
                last = bodies.first[i + 1] - bodies.first[i]
                out[i, j] = nearest(i, j, x[i], t[i], x[j], t[j], 0, last, -np.inf, reach, bodies)[0]
