"""What the levels of a volume are: air, liquid, solid; and which cores are inclusions of others.

A liquid *surrounds* grains: most of the surface of a submerged one that does not touch another lies in it.  A faint
grain touches denser ones at contacts only.  An inclusion lies within one grain, which encloses few others.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from grainmotion.model.large_arrays import large_empty
from grainmotion.segmentation.blocks import Block, Work, slabs_of
from grainmotion.segmentation.heights import Heights
from grainmotion.segmentation.label_measures import faces_on_codes, highest_label, label_sizes
from grainmotion.segmentation.label_pairs import LabelPairs
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


_SAMPLED = (slice(None, None, 2),) * 3
"""Voxels from which it is seen in which piece a grain lies: every other one, in an eighth of the memory."""


@dataclass(frozen=True, eq=False)
class Neighbours:
    """Faces of voxels between regions: ``faces[a, b]`` of regions a and b, and those on the border of the volume."""

    faces: sparse.csr_array
    border: NDArray[np.int64]
    sizes: NDArray[np.int64]

    @classmethod
    def of(cls, regions: Ints, count: int, work: Work) -> Neighbours:
        """Neighbours of regions 1 … ``count``."""
        touching = LabelPairs.of(regions, regions, count, work)
        (a, b), faces = touching.pairs.T, touching.faces.sum(axis=1)
        half = sparse.coo_array((faces, (a, b)), shape=(count + 1, count + 1)).tocsr()
        edge = np.zeros(count + 1, np.int64)
        for axis in range(3):
            for end in (0, -1):
                edge += np.bincount(np.moveaxis(regions, axis, 0)[end].ravel(), minlength=count + 1)
        return cls((half + half.T).tocsr(), edge, label_sizes(regions, count, work))


def connected(neighbours: Neighbours, level_of: NDArray[np.intp]) -> NDArray[np.intp]:
    """Number of the connected part, of one level, that each core belongs to."""
    pairs = neighbours.faces.tocoo()
    same = level_of[pairs.row] == level_of[pairs.col]
    same &= (pairs.row > 0) & (pairs.col > 0)
    graph = sparse.coo_array((np.ones(int(same.sum())), (pairs.row[same], pairs.col[same])), shape=pairs.shape)
    return np.asarray(sparse.csgraph.connected_components(graph, directed=False)[1], np.intp)


def liquid_levels(
    array: Floats, of_voxel: NDArray[np.int8], levels: NDArray[np.float64], work: Work
) -> tuple[int, ...]:
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
    work : Work
        Threads.

    Returns
    -------
    tuple of int
        Numbers of levels.
    """
    return tuple(level for level in range(1, len(levels) - 1) if _is_liquid(array, of_voxel, levels, level, work))


def _is_liquid(array: Floats, of_voxel: NDArray[np.int8], levels: NDArray[np.float64], level: int, work: Work) -> bool:
    """Whether a level surrounds denser grains."""
    dense, base = large_empty(array.shape, bool), np.float32(levels[level])
    slabs = [slice(*slab) for slab in slabs_of(array.shape)]

    def rise(block: Block, reach: int) -> NDArray[np.float32]:
        inside = block.gather(of_voxel, reach, -1, np.int8) > level
        return np.where(inside, block.gather(array, reach, 0) - base, np.float32(0))

    work.each(slabs, lambda slab: np.greater(of_voxel[slab], level, dense[slab]))
    grains = separated(Heights(array.shape, rise), dense, 0.0, SegmentSettings(), work)
    submerged = share_of_surface(grains, of_voxel, level, work) > SUBMERGED
    if np.count_nonzero(submerged) < MIN_SUBMERGED:
        return False

    _mark(dense, of_voxel, level, grains, submerged, work)
    sampled = np.ascontiguousarray(grains[_SAMPLED])
    del grains
    flat = Heights(array.shape, lambda block, reach: block.gather(dense, reach, 0))
    pieces = separated(flat, dense, 0.5, SegmentSettings(), work)
    most = np.bincount(_homes(sampled, np.ascontiguousarray(pieces[_SAMPLED]), submerged, work)).max(initial=0)
    return bool(most >= MIN_SUBMERGED and most >= MOST * np.count_nonzero(submerged))


def _mark(
    mask: NDArray[np.bool_],
    of_voxel: NDArray[np.int8],
    level: int,
    grains: Ints,
    wanted: NDArray[np.bool_],
    work: Work,
) -> None:
    """Make a mask, in place, that of a level and of the wanted grains."""

    def mark(slab: tuple[int, int]) -> None:
        part = slice(*slab)
        mask[part] = (of_voxel[part] == level) | wanted[grains[part]]

    work.each(slabs_of(mask.shape), mark)


def _homes(grains: Ints, pieces: Ints, wanted: NDArray[np.bool_], work: Work) -> NDArray[np.int64]:
    """The piece that holds most of each wanted grain; none for a grain in no piece."""
    width = highest_label(pieces, work) + 1

    def count(slab: tuple[int, int]) -> tuple[NDArray[np.int64], NDArray[np.intp]]:
        grain, piece = grains[slice(*slab)], pieces[slice(*slab)]
        both = wanted[grain] & (piece > 0)
        return np.unique(grain[both].astype(np.int64) * width + piece[both], return_counts=True)

    keys, counts = (np.concatenate(part) for part in zip(*work.each(slabs_of(grains.shape), count), strict=True))
    keys, index = np.unique(keys, return_inverse=True)
    voxels = np.bincount(index, counts, minlength=len(keys))
    order = np.lexsort((keys, -voxels, keys // width))
    first = np.unique((keys // width)[order], return_index=True)[1]
    return np.asarray((keys % width)[order][first], np.int64)


def share_of_surface(labels: Ints, of_voxel: NDArray[np.int8], level: int, work: Work) -> NDArray[np.float64]:
    """Share ``(n + 1,)`` of each label's surface on this or fainter levels that lies on this one; 0 for label 0."""
    faces = faces_on_codes(labels, of_voxel, highest_label(labels, work), work)
    return np.asarray(faces[:, level] / np.maximum(faces[:, : level + 1].sum(axis=1), 1))


def inclusion_hosts(cores: UniformCores, neighbours: Neighbours) -> NDArray[np.intp]:
    """Level of each core ``(n + 1,)``, that of its host for a core that lies within another one of some level."""
    level_of, parts = cores.level_of.copy(), connected(neighbours, cores.level_of)
    sizes, first = np.bincount(parts, neighbours.sizes), np.unique(parts, return_index=True)[1]
    faces = neighbours.faces
    for core in range(1, len(level_of)):
        row = slice(faces.indptr[core], faces.indptr[core + 1])
        across, count = parts[faces.indices[row]], faces.data[row]
        apart = across != parts[core]
        if not apart.any():
            continue
        others, index = np.unique(across[apart], return_inverse=True)
        shared = np.bincount(index, count[apart])
        host = int(others[shared.argmax()])
        whole = count.sum() + neighbours.border[core]
        if sizes[parts[core]] <= sizes[host] and shared.max() >= ENCLOSED * whole:
            level_of[core] = cores.level_of[first[host]]
    return level_of
