"""Where a body lies against the grains: above, below, around or beside them, from counts of voxels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float, Index
from grainmotion.segmentation.settings import Place

MIN_PLACE_SHARE = 0.8
"""Share of a body's attenuation that must be above, below, or in a ring around the grains for the name of the place."""
SECTORS, MIN_SECTORS = 36, 0.75
"""Directions around the grains, and the share of them in which a wall must be."""


@dataclass(frozen=True, eq=False)
class GrainsExtent:
    """Where the grains are.

    Attributes
    ----------
    low, high : float
        Planes below and above which lie 2 % of them.
    middle : (float, float)
        Mean y and x, voxels.
    radius : float
        Distance from there, across z, within which 80 % of them lie, voxels.
    """

    low: float
    high: float
    middle: tuple[float, float]
    radius: float

    @classmethod
    def of(cls, labels: NDArray[np.integer]) -> GrainsExtent | None:
        """The extent of all labels; None if there are none."""
        heights, columns = np.zeros(len(labels), np.int64), np.zeros(labels.shape[1:], np.int64)
        for z, plane in enumerate(labels):
            inside = plane > 0
            heights[z] = np.count_nonzero(inside)
            columns += inside
        if not heights.any():
            return None
        places = np.arange(max(columns.shape))
        y, x = (float(np.average(places[: len(c)], weights=c)) for c in (columns.sum(axis=1), columns.sum(axis=0)))
        low, high = (_quantile(np.arange(len(heights)), heights, share) for share in (0.02, 0.98))
        radius = _quantile(_distances(columns.shape, (y, x)).ravel(), columns.ravel(), 0.8)
        return cls(low, high, (y, x), radius)

    def place(self, start: tuple[int, ...], body: NDArray[np.bool_]) -> Place:
        """Where a body lies that fills a mask whose first voxel is at ``start``."""
        heights, columns = np.array([np.count_nonzero(plane) for plane in body]), body.sum(axis=0)
        z, total = start[0] + np.arange(len(heights)), int(heights.sum())
        if not total:
            return "beside"
        if heights[z > self.high].sum() > MIN_PLACE_SHARE * total:
            return "above"
        if heights[z < self.low].sum() > MIN_PLACE_SHARE * total:
            return "below"
        middle = self.middle[0] - start[1], self.middle[1] - start[2]
        ring = _distances(columns.shape, middle) > self.radius
        y, x = np.nonzero(ring & body[(z >= self.low) & (z <= self.high)].any(axis=0))
        angles = np.arctan2(y - middle[0], x - middle[1])
        filled = np.unique(np.floor((angles / (2 * np.pi) + 0.5) * SECTORS)).size / SECTORS
        around = columns[ring].sum() > (1 - MIN_PLACE_SHARE) * total and filled >= MIN_SECTORS
        return "around" if around else "beside"


def _distances(shape: tuple[int, ...], middle: tuple[float, float]) -> Float:
    """Distance of each column from a place, voxels."""
    y, x = np.ogrid[: shape[0], : shape[1]]
    return np.hypot(y - middle[0], x - middle[1])


def _quantile(values: Float | Index, counts: Index, share: float) -> float:
    """The value below which lies a share, each as often as counted, as `numpy.quantile` gives it."""
    order = np.argsort(values, kind="stable")
    ends = np.cumsum(counts[order])
    place = share * (int(ends[-1]) - 1)
    below, above = (
        float(values[order[np.searchsorted(ends, rank, side="right")]]) for rank in (int(place), -int(-place // 1))
    )
    return below + (place - int(place)) * (above - below)
