"""What the levels of a volume are: air, liquid, solid; and which cores are inclusions of others.

A liquid *surrounds* grains: most of the surface of a submerged one that does not touch another lies in it.  A faint
grain touches denser ones at contacts only.  An inclusion lies within one grain, which encloses few others.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from grainmotion.segmentation.separation import separated
from grainmotion.segmentation.settings import SegmentSettings
from grainmotion.segmentation.uniform_cores import Floats, Ints, UniformCores

SUBMERGED = 0.6
"""Share of a core's surface on fainter levels that lies in one liquid."""
MIN_SUBMERGED = 3
"""Grains that one connected liquid surrounds; a grain has fewer inclusions."""
MOST = 0.5
"""Share of all surrounded cores that one liquid has: the inclusions of a packing lie in many grains."""
ENCLOSED = 0.75
"""Share of an inclusion's whole surface that lies in its host."""


@dataclass(frozen=True, eq=False)
class Neighbours:
    """Faces of voxels between regions: ``faces[a, b]`` of regions a and b, and those on the border of the volume."""

    faces: sparse.csr_array
    border: NDArray[np.int64]
    sizes: NDArray[np.int64]

    @classmethod
    def of(cls, regions: Ints, count: int) -> Neighbours:
        """Neighbours of regions 0 … ``count``."""
        keys, edge = [], np.zeros(count + 1, np.int64)
        for axis in range(3):
            a, b = (np.moveaxis(regions, axis, 0)[part] for part in (slice(None, -1), slice(1, None)))
            apart = a != b
            keys.append(a[apart].astype(np.int64) * (count + 1) + b[apart])
            for end in (0, -1):
                edge += np.bincount(np.moveaxis(regions, axis, 0)[end].ravel(), minlength=count + 1)
        key, times = np.unique(np.concatenate(keys), return_counts=True)
        shape = (count + 1, count + 1)
        half = sparse.coo_array((times, (key // (count + 1), key % (count + 1))), shape=shape).tocsr()
        return cls((half + half.T).tocsr(), edge, np.bincount(regions.ravel(), minlength=count + 1))


def connected(neighbours: Neighbours, level_of: NDArray[np.intp]) -> NDArray[np.intp]:
    """Number of the connected part, of one level, that each core belongs to."""
    pairs = neighbours.faces.tocoo()
    same = level_of[pairs.row] == level_of[pairs.col]
    same &= (pairs.row > 0) & (pairs.col > 0)
    graph = sparse.coo_array((np.ones(int(same.sum())), (pairs.row[same], pairs.col[same])), shape=pairs.shape)
    return np.asarray(sparse.csgraph.connected_components(graph, directed=False)[1], np.intp)


def liquid_levels(array: Floats, of_voxel: NDArray[np.int8], levels: NDArray[np.float64]) -> tuple[int, ...]:
    """Levels above the lowest that surround denser grains.

    A packing of grains with inclusions would, too, but it falls apart into grains, each with few of the inclusions.

    Parameters
    ----------
    array : (nz, ny, nx) array
        Attenuation, 1/mm.
    of_voxel : (nz, ny, nx) int8 array
        Number of each voxel's level.
    levels : (k,) array
        Attenuation of the levels, rising, 1/mm.

    Returns
    -------
    tuple of int
        Numbers of levels.
    """
    found, settings = [], SegmentSettings()
    for level in range(1, len(levels) - 1):
        dense = of_voxel > level
        grains = separated(np.where(dense, array - np.float32(levels[level]), 0), dense, 0.0, settings)
        inside = np.flatnonzero(share_of_surface(grains, of_voxel, level) > SUBMERGED)
        if len(inside) < MIN_SUBMERGED:
            continue
        whole = (of_voxel == level) | np.isin(grains, inside)
        pieces = separated(whole.astype(np.float32), whole, 0.5, settings)
        width = int(pieces.max()) + 1
        held = np.bincount((grains * width + pieces).ravel(), minlength=(int(grains.max()) + 1) * width)
        homes = held.reshape(-1, width)[inside, 1:].argmax(axis=1) if width > 1 else np.zeros(0, int)
        most = np.bincount(homes).max(initial=0)
        if most >= MIN_SUBMERGED and most >= MOST * len(inside):
            found.append(level)
    return tuple(found)


def share_of_surface(labels: Ints, of_voxel: NDArray[np.int8], level: int) -> NDArray[np.float64]:
    """Share ``(n + 1,)`` of each label's surface on this or fainter levels that lies on this one; 0 for label 0."""
    count = int(labels.max()) + 1
    on, total = np.zeros(count), np.zeros(count)
    for axis in range(3):
        own, near = np.moveaxis(labels, axis, 0), np.moveaxis(of_voxel, axis, 0)
        for inner, outer in ((slice(None, -1), slice(1, None)), (slice(1, None), slice(None, -1))):
            face = (own[inner] > 0) & (near[outer] <= level)
            total += np.bincount(own[inner][face], minlength=count)
            face &= near[outer] == level
            on += np.bincount(own[inner][face], minlength=count)
    return np.asarray(on / np.maximum(total, 1))


def without_inclusions(cores: UniformCores, neighbours: Neighbours, fluid: tuple[int, ...]) -> NDArray[np.intp]:
    """Level of each core ``(n + 1,)``, that of its host for an inclusion: a core that lies within another solid."""
    level_of, parts = cores.level_of.copy(), connected(neighbours, cores.level_of)
    sizes = np.bincount(parts, neighbours.sizes)
    for core in np.argsort(neighbours.sizes):
        if core == 0:
            continue
        row = neighbours.faces[[core]].tocoo()
        across = parts[row.col]
        others = np.bincount(across[across != parts[core]], row.data[across != parts[core]], minlength=len(sizes))
        host = int(others.argmax()) if len(others) else 0
        level = int(cores.level_of[np.flatnonzero(parts == host)[0]])
        if (
            level in fluid
            or sizes[parts[core]] > sizes[host]
            or others[host] < ENCLOSED * (row.data.sum() + neighbours.border[core])
        ):
            continue
        level_of[core] = level
    return level_of
