"""Bodies of a packing as flat arrays for `kernels.packing`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from grainmotion._typing import Float
from grainmotion.simulate.polyhedra import icosphere
from grainmotion.simulate.signed_distance import Locator

COARSE_PROBES = 642  # probes tested before all others: the directions of icosphere level 3


class Bodies(NamedTuple):
    """n locators, concatenated; indices of vertices and faces count from the first body's.

    ``clusters`` (c, 4) are bounding spheres (centre, radius) of groups of probes, of which cluster k ends at probe
    ``ends[k]``.  Body i has the clusters ``first[i]`` to ``first[i + 1]``; the first ``coarse[i]`` have coarse probes.
    """

    probes: Float
    clusters: Float
    ends: NDArray[np.int64]
    first: NDArray[np.int64]
    coarse: NDArray[np.int64]
    vertices: Float
    faces: NDArray[np.int64]
    planes: Float
    across: NDArray[np.int64]
    starts: NDArray[np.int64]
    reaches: Float
    radii: Float


class Poses(NamedTuple):
    """Poses of the bodies: origins ``(n, 3)``, mm, and rotation matrices ``(n, 3, 3)``."""

    positions: Float
    rotations: Float


class Rules(NamedTuple):
    """Limits of a move, mm: radius of the cylinder, gap between surfaces, and mean diameter that scales the steps."""

    radius: float
    gap: float
    size: float


def stack(located: list[Locator]) -> Bodies:
    """Concatenate locators, their probes sorted into clusters."""
    groups, first, coarse = [], [0], []
    for body in located:
        coarse_groups = _groups(body.probes[:COARSE_PROBES], 1)
        groups += coarse_groups + _groups(body.probes[COARSE_PROBES:], 2)
        coarse.append(len(coarse_groups))
        first.append(len(groups))
    middles = np.array([group.mean(axis=0) for group in groups])
    sizes = [np.linalg.norm(group - middle, axis=1).max() for group, middle in zip(groups, middles, strict=True)]
    vertex = np.cumsum([0, *(len(b.vertices) for b in located)])
    face = np.cumsum([0, *(len(b.faces) for b in located)])
    return Bodies(
        probes=np.concatenate(groups),
        clusters=np.column_stack([middles, sizes]),
        ends=np.cumsum([len(g) for g in groups]),
        first=np.array(first),
        coarse=np.array(coarse),
        vertices=np.concatenate([b.vertices for b in located]),
        faces=np.concatenate([b.faces + start for b, start in zip(located, vertex, strict=False)]),
        planes=np.concatenate([b.planes for b in located]),
        across=np.concatenate([b.across + start for b, start in zip(located, face, strict=False)]),
        starts=np.stack([b.start + start for b, start in zip(located, face, strict=False)]),
        reaches=np.stack([b.reach for b in located]),
        radii=np.array([b.radius for b in located]),
    )


def _groups(probes: Float, level: int) -> list[Float]:
    """Probes grouped by the nearest direction of a coarse icosphere."""
    if len(probes) == 0:
        return []
    _, nearest = cKDTree(icosphere(level)[0]).query(probes / np.linalg.norm(probes, axis=1, keepdims=True))
    return [probes[nearest == k] for k in np.unique(nearest)]
