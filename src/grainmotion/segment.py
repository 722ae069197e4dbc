"""Segmentation: Volume → labels.  Threshold, distance transform, watershed, and which basins are one grain.

A watershed of the distance transform cuts angular grains into several basins.  Basins are put together
again in two steps over the graph of touching basins:

1. **Depth** (H-minima): a basin whose peak stands less than ``depth`` voxels above its saddle is no
   basin.  This removes what the voxels themselves make.
2. **Neck and visibility**, free of scale, the best pair first: two basins are one grain if

       κ = r · V ≥ ``oneness``,

   with r the half-width of the neck over that of the smaller basin (saddle over peak of the distance),
   and V the share of straight lines from points of one to points of the other that stay inside the two.
   Two grains that touch have a narrow neck or do not see each other through it; two halves of one
   grain do both.

Soille (2003) for the watershed on distances; `docs/decisions/0002-segmentation.md` for the measure.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from dataclasses import dataclass as record
from typing import Annotated

import edt
import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from pydantic.dataclasses import dataclass
from scipy import ndimage
from skimage.filters import threshold_otsu
from skimage.segmentation import watershed

from grainmotion.errors import InputError
from grainmotion.grains import Background
from grainmotion.volume import Volume

Progress = Callable[[str, int, int], None]
Ints = NDArray[np.int32]

SIGHTS = 600  # lines tried between two basins
STEPS = 48  # places looked at on each line
NECK_AT_LEAST = 0.3  # a narrower neck is never looked through
SMALL = 0.02  # of the median grain's volume: the smallest grain, unless given
SPECK = 30  # voxels: what is smaller is no grain in any case


@dataclass(frozen=True)
class SegmentSettings:
    """How to find the grains."""

    threshold: Annotated[
        float | None, Field(description="attenuation from which a voxel is grain, 1/mm; Otsu's unless given")
    ] = None
    depth: Annotated[
        float, Field(ge=0, description="least height of a distance peak over its saddle (H-minima), voxels")
    ] = 0.5
    oneness: Annotated[
        float, Field(gt=0, description="two basins are one grain from this neck times visibility; lower merges more")
    ] = 0.475
    min_volume: Annotated[
        int | None, Field(gt=0, description="smallest grain, voxels; 2 % of the median grain unless given")
    ] = None
    reach: Annotated[
        float, Field(ge=0, description="attenuation without a label goes to the nearest grain this far away, voxels")
    ] = 3.0
    background: Annotated[
        Background, Field(description='what is further away: "ignore" it, or keep it "fixed" in all states')
    ] = "ignore"


@dataclass(frozen=True, config={"arbitrary_types_allowed": True})
class Segmentation:
    """Where the grains are.

    Attributes
    ----------
    labels : (nz, ny, nx) int32 array
        0 for no grain, 1 … n for the grains.
    threshold : float
        Attenuation used, 1/mm.
    border : tuple of int
        Labels that touch the border of the field of view, and so may be incomplete.
    """

    labels: Ints
    threshold: float
    border: tuple[int, ...]


def segment(volume: Volume, settings: SegmentSettings | None = None, progress: Progress | None = None) -> Segmentation:
    """Find the grains of a volume.

    Parameters
    ----------
    volume : Volume
        Attenuation, 1/mm.
    settings : SegmentSettings, optional
    progress : callable, optional
        Called as ``progress(message, done, total)``.

    Returns
    -------
    Segmentation

    Raises
    ------
    InputError
        If no grain is found.
    """
    settings = settings or SegmentSettings()

    def tell(message: str, done: int) -> None:
        if progress is not None:
            progress(message, done, 4)

    tell("threshold", 0)
    threshold, solid = _solid(volume, settings)
    tell("distances and watershed", 1)
    distance = edt.edt(solid, parallel=1)
    basins = _basins(distance, solid)
    tell("which basins are one grain", 2)
    graph = _Graph.of(distance, basins)
    labels = graph.merge_shallow(settings.depth)[basins]
    labels = _merge_whole(distance, labels, settings.oneness)[labels]
    tell("small objects", 3)
    labels = _kept(labels, settings.min_volume)
    if labels.max() == 0:
        raise InputError(
            "segment.threshold", f"no grains found above {threshold:.4g} 1/mm", "lower it, or lower segment.min_volume"
        )
    tell(f"{labels.max()} grains", 4)
    return Segmentation(labels, threshold, border_labels(labels))


def border_labels(labels: NDArray[np.integer]) -> tuple[int, ...]:
    """Labels that touch a face of the array, or the border of its inscribed upright cylinder."""
    _, ny, nx = labels.shape
    edge = np.zeros(labels.shape, dtype=bool)
    edge[[0, -1]] = edge[:, [0, -1]] = edge[:, :, [0, -1]] = True
    y, x = np.arange(ny) - (ny - 1) / 2, np.arange(nx) - (nx - 1) / 2
    edge[:, np.hypot(y[:, None], x[None, :]) > min(ny, nx) / 2 - 1.5] = True
    return tuple(int(i) for i in np.unique(labels[edge]) if i)


def _solid(volume: Volume, settings: SegmentSettings) -> tuple[float, NDArray[np.bool_]]:
    """The threshold, and the voxels above it with holes filled and specks removed."""
    array = volume.array
    if array.max() <= array.min():
        raise InputError("segment.threshold", "no grains found: the volume is uniform", "check the volume")
    threshold = settings.threshold if settings.threshold is not None else float(threshold_otsu(array))
    solid = ndimage.binary_fill_holes(array > threshold)
    pieces, n = ndimage.label(solid)
    large = np.bincount(pieces.ravel(), minlength=n + 1) >= min(settings.min_volume or SPECK, SPECK)
    large[0] = False
    return threshold, large[pieces]


def _basins(distance: NDArray[np.float32], solid: NDArray[np.bool_]) -> Ints:
    """Watershed from every local maximum of the distance."""
    peaks = (distance == ndimage.maximum_filter(distance, size=3)) & solid
    seeds, _ = ndimage.label(peaks, np.ones((3, 3, 3)))
    return watershed(-distance, seeds, mask=solid).astype(np.int32)


@record
class _Graph:
    """Touching basins: ``peaks (n + 1,)`` of the distance, and the saddle of each pair ``(i, j)``, i < j."""

    peaks: NDArray[np.float64]
    pairs: NDArray[np.int64]
    saddles: NDArray[np.float64]

    @classmethod
    def of(cls, distance: NDArray[np.float32], basins: Ints) -> _Graph:
        n = int(basins.max())
        peaks = np.zeros(n + 1)
        if n:
            peaks[1:] = ndimage.maximum(distance, basins, np.arange(1, n + 1))
        keys, heights = [], []
        for axis in range(3):
            first = tuple(slice(None, -1) if k == axis else slice(None) for k in range(3))
            second = tuple(slice(1, None) if k == axis else slice(None) for k in range(3))
            a, b = basins[first], basins[second]
            meet = (a != b) & (a > 0) & (b > 0)
            low, high = np.minimum(a[meet], b[meet]).astype(np.int64), np.maximum(a[meet], b[meet])
            keys.append(low * (n + 1) + high)
            heights.append(np.minimum(distance[first][meet], distance[second][meet]))
        key, height = np.concatenate(keys), np.concatenate(heights)
        unique, index = np.unique(key, return_inverse=True)
        saddles = np.zeros(len(unique))
        np.maximum.at(saddles, index, height)
        return cls(peaks, np.column_stack([unique // (n + 1), unique % (n + 1)]), saddles)

    def merge_shallow(self, depth: float) -> Ints:
        """New labels ``(n + 1,)`` once peaks less than ``depth`` above their highest saddle have joined."""
        root = np.arange(len(self.peaks))
        for k in np.argsort(-self.saddles):
            a, b = (_find(root, int(i)) for i in self.pairs[k])
            low, high = (a, b) if self.peaks[a] < self.peaks[b] else (b, a)
            if a != b and self.peaks[low] - self.saddles[k] < depth:
                root[low] = high
        return _renumbered(np.array([_find(root, i) for i in range(len(root))]))


def _merge_whole(distance: NDArray[np.float32], labels: Ints, oneness: float) -> Ints:
    """New labels ``(n + 1,)`` once basins that are one grain have joined, the surest pair first."""
    graph = _Graph.of(distance, labels)
    n = len(graph.peaks) - 1
    root = np.arange(n + 1)
    peaks = graph.peaks.copy()
    necks: list[dict[int, float]] = [{} for _ in range(n + 1)]
    for (a, b), saddle in zip(graph.pairs, graph.saddles, strict=True):
        necks[a][int(b)] = necks[b][int(a)] = float(saddle)
    points = _points(labels, n)
    version = np.zeros(n + 1, dtype=int)
    rng = np.random.default_rng(0)
    queue: list[tuple[float, int, int, int, int]] = []

    def offer(a: int, b: int) -> None:
        neck = necks[a][b] / min(peaks[a], peaks[b])
        if neck < max(NECK_AT_LEAST, oneness):
            return  # visibility is at most 1
        score = neck * _visibility(labels, root, (a, points[a]), (b, points[b]), rng)
        if score >= oneness:
            heapq.heappush(queue, (-score, a, b, version[a], version[b]))

    for a in range(1, n + 1):
        for b in necks[a]:
            if a < b:
                offer(a, b)
    while queue:
        _, a, b, va, vb = heapq.heappop(queue)
        if version[a] != va or version[b] != vb:
            continue
        root[root == b] = a
        peaks[a] = max(peaks[a], peaks[b])
        points[a] = np.concatenate([points[a], points[b]])
        version[a] += 1
        version[b] = -1
        for c, saddle in necks[b].items():
            del necks[c][b]
            if c != a:
                necks[a][c] = necks[c][a] = max(saddle, necks[a].get(c, 0.0))
        necks[b] = {}
        for c in necks[a]:
            offer(min(a, c), max(a, c))
    return _renumbered(root)


def _visibility(
    labels: Ints,
    root: NDArray[np.int64],
    one: tuple[int, NDArray[np.int16]],
    other: tuple[int, NDArray[np.int16]],
    rng: np.random.Generator,
) -> float:
    """Share of straight lines from points of one basin to points of the other that stay inside the two."""
    (a, from_points), (b, to_points) = one, other
    start = from_points[rng.integers(len(from_points), size=SIGHTS)].astype(np.float32)
    end = to_points[rng.integers(len(to_points), size=SIGHTS)].astype(np.float32)
    t = ((np.arange(STEPS) + 0.5) / STEPS).astype(np.float32)
    at = np.rint(start[:, None] + (end - start)[:, None] * t[None, :, None]).astype(np.intp)
    met = root[labels[at[..., 0], at[..., 1], at[..., 2]]]
    return float(((met == a) | (met == b)).all(axis=1).mean())


def _points(labels: Ints, n: int) -> list[NDArray[np.int16]]:
    """Voxels (z, y, x) of each label 0 … n; none for 0."""
    flat = labels.ravel()
    inside = np.flatnonzero(flat)
    inside = inside[np.argsort(flat[inside], kind="stable")]
    ends = np.cumsum(np.bincount(flat[inside], minlength=n + 1))
    place = np.stack(np.unravel_index(inside, labels.shape), axis=1).astype(np.int16)
    return [place[start:end] for start, end in zip(np.concatenate([[0], ends[:-1]]), ends, strict=True)]


def _kept(labels: Ints, min_volume: int | None) -> Ints:
    """Labels without the small objects, numbered 1 … n."""
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    grains = sizes[sizes >= SPECK]
    least = min_volume or max(SPECK, int(SMALL * np.median(grains)) if len(grains) else SPECK)
    return _renumbered(np.where(sizes >= least, np.arange(len(sizes)), 0))[labels]


def _find(root: NDArray[np.int64], i: int) -> int:
    while root[i] != i:
        root[i] = root[root[i]]
        i = int(root[i])
    return i


def _renumbered(labels: NDArray[np.integer]) -> Ints:
    """The same partition with 0 kept and the others numbered 1 … n."""
    values, index = np.unique(np.concatenate([[0], labels]), return_inverse=True)
    assert values[0] == 0
    return index[1:].astype(np.int32)
