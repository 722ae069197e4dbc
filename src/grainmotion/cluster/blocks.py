"""Blocks of grains: what one task walks.  They follow from the grains alone, never from who is there to work."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from grainmotion.geometry import Geometry
from grainmotion.packed import PackedGrains, Pose

Index = NDArray[np.int64]

FEWEST = 6
"""Grains of a block, where there are enough of them: a task of fewer costs less than to hand it out."""
REACH = 1.2
"""Times a grain's own reach: where its shadow is guessed to end, see `guessed_rows`."""


@dataclass(frozen=True, eq=False)
class Block:
    """Some grains: their rows in the sample, and they themselves without the others' voxels."""

    rows: Index
    grains: PackedGrains


def block_rows(grains: PackedGrains) -> list[Index]:
    """Rows of the grains of each block, about equal in work.

    Grains of one block are neighbours along z, because radiographs see z as it is: blocks then share few rows of
    pixels, which is what they have to tell each other.
    """
    n = len(grains)
    count = min(n, max(2, round(n / max(FEWEST, np.sqrt(n) / 2))))
    order = np.argsort(grains.centers[:, 2], kind="stable")
    work = grains.radii[order] ** 3  # rays go with r², samples of each with r
    block = ((np.cumsum(work) - work / 2) / work.sum() * count).astype(int)
    return [order[block == k] for k in np.unique(block)]


def cut(grains: PackedGrains, rows: Index) -> Block:
    """A block with copies of its voxels."""
    sizes = grains.shapes[rows].prod(axis=1)
    images = [grains.images[s : s + k] for s, k in zip(grains.starts[rows], sizes, strict=True)]
    starts = np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int64)
    return Block(rows, replace(grains.select(rows), images=np.concatenate(images), starts=starts))


def posed(pose: Pose, rows: Index) -> Pose:
    """The pose of some grains."""
    return Pose(pose.translations[rows], pose.matrices[rows], pose.surroundings)


def guessed_rows(
    grains: PackedGrains, pose: Pose, geometry: Geometry, margin: int, blocks: list[Index]
) -> dict[int, tuple[int, int]]:
    """Rows of pixels that each block probably touches; the workers know, and say so."""
    places = grains.centers + pose.translations
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = REACH * np.linalg.norm(grains.hulls, axis=2).max(axis=1) / geometry.pixels_at(places) + margin + 4
    spots = geometry.project_points(places)[..., 0]  # (views, n)
    low, high = (np.nan_to_num(spots + side * reach, nan=0.0, posinf=1e9, neginf=-1e9) for side in (-1, 1))
    found = {}
    for k, rows in enumerate(blocks):
        found[k] = int(np.floor(low[:, rows].min())), int(np.ceil(high[:, rows].max()))
    return found
