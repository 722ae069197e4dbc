# mypy: allow-untyped-defs
"""Kernels of the packing: bodies as flat arrays, overlap, falling and settling.

Two bodies overlap where a surface point (probe) of one lies inside the other.  Most probes are ruled
out in clusters by bounding spheres, most others by a map of the radius against the direction; the
probes that blocked the last moves are tried first, since they will block most of the next.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from grainmotion.simulate.contact import Locator
from grainmotion.simulate.shapes import Array, icosphere
from grainmotion.simulate.walk import cell, distance

COARSE = 642  # probes tested before all the others: the directions of icosphere level 3
REMEMBERED = 8  # probes that blocked the last moves


class Bodies(NamedTuple):
    """n locators end to end.

    ``offsets`` (n + 1, 4) counts probes, clusters, vertices and faces before each body; ``clusters`` (c, 4)
    are the bounding spheres of the probes up to ``ends``; the first ``coarse`` clusters of a body hold
    its coarse probes.
    """

    probes: Array
    clusters: Array
    ends: NDArray[np.int64]
    coarse: NDArray[np.int64]
    vertices: Array
    faces: NDArray[np.int32]
    planes: Array
    across: NDArray[np.int32]
    starts: NDArray[np.int32]
    reaches: Array
    offsets: NDArray[np.int64]
    radii: Array


class Poses(NamedTuple):
    """Where the bodies are: origins ``(n, 3)`` and rotation matrices ``(n, 3, 3)``."""

    positions: Array
    turns: Array


class Rules(NamedTuple):
    """What limits a move, mm: the cylinder's radius, the gap kept, and the size that scales the steps."""

    radius: float
    gap: float
    size: float


def stack(located: list[Locator]) -> Bodies:
    """Bodies of some locators, their probes sorted into clusters."""
    probes, clusters, counts, coarse = [], [], [], []
    for body in located:
        groups = _groups(body.probes[:COARSE], 1) + _groups(body.probes[COARSE:], 2)
        coarse.append(len(_groups(body.probes[:COARSE], 1)))
        probes.extend(groups)
        for group in groups:
            middle = group.mean(axis=0)
            clusters.append([*middle, np.linalg.norm(group - middle, axis=1).max()])
        counts.append([len(body.probes), len(groups), len(body.vertices), len(body.faces)])
    return Bodies(
        probes=np.concatenate(probes),
        clusters=np.array(clusters),
        ends=np.cumsum([len(g) for g in probes]),
        coarse=np.array(coarse),
        vertices=np.concatenate([b.vertices for b in located]),
        faces=np.concatenate([b.faces for b in located]),
        planes=np.concatenate([b.planes for b in located]),
        across=np.concatenate([b.across for b in located]),
        starts=np.stack([b.start for b in located]),
        reaches=np.stack([b.reach for b in located]),
        offsets=np.concatenate([np.zeros((1, 4), np.int64), np.cumsum(counts, axis=0)]),
        radii=np.array([b.radius for b in located]),
    )


def _groups(probes: Array, level: int) -> list[Array]:
    """Probes grouped by the nearest of the directions of a coarse icosphere."""
    if len(probes) == 0:
        return []
    _, nearest = cKDTree(icosphere(level)[0]).query(probes / np.linalg.norm(probes, axis=1, keepdims=True))
    return [probes[nearest == k] for k in np.unique(nearest)]


# ---------------------------------------------------------------------- overlap
@numba.njit(cache=True)
def turn_matrix(w):
    """Rotation matrix of a rotation vector."""
    angle = math.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
    out = np.eye(3)
    if angle > 0.0:
        k = np.zeros((3, 3))
        k[0, 1], k[0, 2], k[1, 2] = -w[2] / angle, w[1] / angle, -w[0] / angle
        k = k - k.T
        out += math.sin(angle) * k + (1.0 - math.cos(angle)) * (k @ k)
    return out


@numba.njit(cache=True)
def _apart(a, b):
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@numba.njit(cache=True)
def _probe_distance(x, y, z, j, reach, bodies):
    """Signed distance of a point in body j's frame to its surface; infinite if surely beyond ``reach``."""
    far = math.sqrt(x * x + y * y + z * z)
    row, column = cell(x, y, z)
    if far > bodies.reaches[j, row, column] + reach:
        return np.inf
    v0, v1 = bodies.offsets[j, 2], bodies.offsets[j + 1, 2]
    f0, f1 = bodies.offsets[j, 3], bodies.offsets[j + 1, 3]
    return distance(
        x,
        y,
        z,
        bodies.vertices[v0:v1],
        bodies.faces[f0:f1],
        bodies.planes[f0:f1],
        bodies.across[f0:f1],
        bodies.starts[j],
    )


@numba.njit(cache=True)
def nearest(i, j, xi, ti, xj, tj, first, last, stop, reach, bodies):
    """Least signed distance of probes of body i (clusters ``first`` to ``last``) to body j, and the probe.

    Probes further than ``reach`` from the surface may be passed over; ends early once below ``stop``.
    """
    best, which = np.inf, -1
    m = tj.T @ ti
    s = tj.T @ (xi - xj)
    limit = bodies.radii[j] + reach
    for c in range(bodies.offsets[i, 1] + first, bodies.offsets[i, 1] + last):
        p = bodies.clusters[c]
        x = m[0, 0] * p[0] + m[0, 1] * p[1] + m[0, 2] * p[2] + s[0]
        y = m[1, 0] * p[0] + m[1, 1] * p[1] + m[1, 2] * p[2] + s[1]
        z = m[2, 0] * p[0] + m[2, 1] * p[1] + m[2, 2] * p[2] + s[2]
        if x * x + y * y + z * z > (limit + p[3]) ** 2:
            continue
        for k in range(bodies.ends[c - 1] if c > 0 else 0, bodies.ends[c]):
            p = bodies.probes[k]
            x = m[0, 0] * p[0] + m[0, 1] * p[1] + m[0, 2] * p[2] + s[0]
            y = m[1, 0] * p[0] + m[1, 1] * p[1] + m[1, 2] * p[2] + s[1]
            z = m[2, 0] * p[0] + m[2, 1] * p[1] + m[2, 2] * p[2] + s[2]
            d = _probe_distance(x, y, z, j, reach, bodies)
            if d < best:
                best, which = d, k
                if best < stop:
                    return best, which
    return best, which


@numba.njit(cache=True)
def _inside_cylinder(i, x, t, first, last, bodies, rules):
    """Whether probes of body i (clusters ``first`` to ``last``) are above the floor and within the wall."""
    for c in range(bodies.offsets[i, 1] + first, bodies.offsets[i, 1] + last):
        p = bodies.clusters[c]
        a = t[0, 0] * p[0] + t[0, 1] * p[1] + t[0, 2] * p[2] + x[0]
        b = t[1, 0] * p[0] + t[1, 1] * p[1] + t[1, 2] * p[2] + x[1]
        z = t[2, 0] * p[0] + t[2, 1] * p[1] + t[2, 2] * p[2] + x[2]
        if z > p[3] and math.hypot(a, b) + p[3] < rules.radius:
            continue
        for k in range(bodies.ends[c - 1] if c > 0 else 0, bodies.ends[c]):
            p = bodies.probes[k]
            a = t[0, 0] * p[0] + t[0, 1] * p[1] + t[0, 2] * p[2] + x[0]
            b = t[1, 0] * p[0] + t[1, 1] * p[1] + t[1, 2] * p[2] + x[1]
            z = t[2, 0] * p[0] + t[2, 1] * p[1] + t[2, 2] * p[2] + x[2]
            if z < 0.0 or a * a + b * b > rules.radius * rules.radius:
                return False
    return True


@numba.njit(cache=True)
def _free(i, count, x, t, poses, bodies, rules, blockers):
    """Whether body i at (x, t) keeps the gap to the first ``count`` bodies, the floor z = 0 and the wall."""
    reach = 3.0 * rules.gap
    for b in range(REMEMBERED):
        side, j, k = blockers[b]
        if side < 0:
            break
        p = bodies.probes[k]
        if side == 0:
            q = poses.turns[j].T @ (t @ p + x - poses.positions[j])
            d = _probe_distance(q[0], q[1], q[2], j, reach, bodies)
        else:
            q = t.T @ (poses.turns[j] @ p + poses.positions[j] - x)
            d = _probe_distance(q[0], q[1], q[2], i, reach, bodies)
        if d < rules.gap:
            return False
    for stage in range(2):
        n = bodies.offsets[i + 1, 1] - bodies.offsets[i, 1]
        first, last = (0, bodies.coarse[i]) if stage == 0 else (bodies.coarse[i], n)
        if not _inside_cylinder(i, x, t, first, last, bodies, rules):
            return False
        for j in range(count):
            if j == i or _apart(x, poses.positions[j]) > bodies.radii[i] + bodies.radii[j] + rules.gap:
                continue
            for side in range(2):
                xj, tj = poses.positions[j], poses.turns[j]
                if side == 0:
                    best, which = nearest(i, j, x, t, xj, tj, first, last, rules.gap, reach, bodies)
                else:
                    n = bodies.offsets[j + 1, 1] - bodies.offsets[j, 1]
                    begin, end = (0, bodies.coarse[j]) if stage == 0 else (bodies.coarse[j], n)
                    best, which = nearest(j, i, xj, tj, x, t, begin, end, rules.gap, reach, bodies)
                if best < rules.gap:
                    blockers[1:] = blockers[:-1].copy()
                    blockers[0, 0], blockers[0, 1], blockers[0, 2] = side, j, which
                    return False
    return True


# ---------------------------------------------------------------------- motion
@numba.njit(cache=True)
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


@numba.njit(cache=True)
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
            poses.positions[i], poses.turns[i] = x, t


@numba.njit(cache=True)
def settle(i, count, poses, bodies, rules, moves, rng):
    """Small random moves that lower body i among the first ``count`` bodies."""
    step = 0.1
    blockers = np.full((REMEMBERED, 3), -1)
    for _ in range(moves):
        shift = rng.normal(0.0, step * rules.size, 3)
        shift[2] = -abs(shift[2]) if rng.random() < 0.8 else -0.05 * step * rules.size
        spin = rng.normal(0.0, 2.0 * step, 3) if rng.random() < 0.7 else np.zeros(3)
        x, t = poses.positions[i] + shift, turn_matrix(spin) @ poses.turns[i]
        if _free(i, count, x, t, poses, bodies, rules, blockers):
            poses.positions[i], poses.turns[i] = x, t
            step = min(0.2, step * 1.6)
        else:
            step *= 0.97
        if step < 2e-4:
            break


@numba.njit(cache=True)
def all_gaps(poses, bodies, reach, out):
    """Fill ``out`` (n, n) with the least signed distance of body i's probes to body j, up to ``reach``."""
    x, t = poses.positions, poses.turns
    for i in range(len(x)):
        for j in range(len(x)):
            if i != j and _apart(x[i], x[j]) < bodies.radii[i] + bodies.radii[j] + reach:
                last = bodies.offsets[i + 1, 1] - bodies.offsets[i, 1]
                out[i, j] = nearest(i, j, x[i], t[i], x[j], t[j], 0, last, -np.inf, reach, bodies)[0]
