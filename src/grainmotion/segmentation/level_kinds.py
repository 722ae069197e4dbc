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
from grainmotion.segmentation.uniform_cores import Ints, UniformCores

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


def liquid_levels(cores: UniformCores, regions: Ints, neighbours: Neighbours) -> tuple[int, ...]:
    """Levels above the lowest that surround denser grains.

    A packing of grains with inclusions would, too, but it falls apart into grains, each with few of the inclusions.
    """
    found = []
    for level in range(1, len(cores.levels) - 1):
        inside = _submerged(cores, neighbours, level)
        if len(inside) < MIN_SUBMERGED:
            continue
        whole = np.isin(regions, np.concatenate([np.flatnonzero(cores.level_of == level), inside]))
        whole &= regions > 0
        pieces = separated(whole.astype(np.float32), whole, 0.5, SegmentSettings())
        homes = [int(np.bincount(pieces[cores.labels == core]).argmax()) for core in inside]
        most = np.bincount(homes)[1:].max(initial=0)
        if most >= MIN_SUBMERGED and most >= MOST * len(inside):
            found.append(level)
    return tuple(found)


def _submerged(cores: UniformCores, neighbours: Neighbours, level: int) -> NDArray[np.intp]:
    """Denser cores most of whose surface on fainter levels lies in one connected part of a level."""
    level_of, parts = cores.level_of, connected(neighbours, cores.level_of)
    denser = np.flatnonzero(level_of > level)
    faces = neighbours.faces[denser].tocoo()
    fainter = level_of[faces.col] < level_of[denser[faces.row]]
    total = np.bincount(faces.row[fainter], faces.data[fainter], minlength=len(denser))
    own = level_of[faces.col] == level
    share = np.zeros((len(denser), int(parts.max()) + 1))
    np.add.at(share, (faces.row[own], parts[faces.col[own]]), faces.data[own])
    return denser[share.max(axis=1) > SUBMERGED * np.maximum(total, 1)]


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
