"""Segmentation: Volume → labels.  (First version: threshold, distance, watershed, necks.)"""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated

import edt
import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from pydantic.dataclasses import dataclass
from scipy import ndimage
from skimage.filters import threshold_otsu
from skimage.morphology import remove_small_objects
from skimage.segmentation import relabel_sequential, watershed

from grainmotion.errors import InputError
from grainmotion.volume import Volume


@dataclass(frozen=True)
class SegmentSettings:
    """How to find the grains."""

    threshold: Annotated[float | None, Field(description="attenuation of a grain, 1/mm; Otsu's if not given")] = None
    neck: Annotated[float, Field(description="basins are one grain if the neck is wider than this share")] = 0.74
    min_volume: Annotated[int | None, Field(description="smallest grain, voxels")] = None


@dataclass(frozen=True, config={"arbitrary_types_allowed": True})
class Segmentation:
    """Labels (int32), the threshold used, and the labels at the border."""

    labels: NDArray[np.int32]
    threshold: float
    border: tuple[int, ...]


def segment(
    volume: Volume, settings: SegmentSettings | None = None, progress: Callable[[str, int, int], None] | None = None
) -> Segmentation:
    """Find the grains of a volume."""
    settings = settings or SegmentSettings()
    v = volume.array
    if v.max() <= v.min():
        raise InputError("segment.threshold", "no grains found in a uniform volume", "check the volume")
    t = settings.threshold if settings.threshold is not None else float(threshold_otsu(v))
    mask = ndimage.binary_fill_holes(v > t)
    if not mask.any():
        raise InputError("segment.threshold", f"no grains found above {t:g} 1/mm", "lower it")
    d = edt.edt(mask, parallel=1)
    peaks = (d == ndimage.maximum_filter(d, size=3)) & mask
    seeds, n = ndimage.label(peaks, np.ones((3, 3, 3)))
    ws = watershed(-d, seeds, mask=mask)
    top = np.zeros(n + 1)
    top[1:] = ndimage.maximum(d, ws, np.arange(1, n + 1))
    pairs: dict[tuple[int, int], float] = {}
    for axis in range(3):
        a = np.moveaxis(ws, axis, 0)
        da = np.moveaxis(d, axis, 0)
        l, r = a[:-1], a[1:]
        m = (l != r) & (l > 0) & (r > 0)
        h = np.minimum(da[:-1], da[1:])[m]
        for i, j, x in zip(l[m], r[m], h):
            k = (min(i, j), max(i, j))
            if x > pairs.get(k, 0):
                pairs[k] = x
    root = np.arange(n + 1)

    def find(i: int) -> int:
        while root[i] != i:
            i = root[i]
        return i

    for (i, j), h in sorted(pairs.items(), key=lambda e: -e[1]):
        a, b = find(i), find(j)
        if a != b and (h > settings.neck * min(top[a], top[b]) or min(top[a], top[b]) - h < 0.5):
            root[b if top[a] >= top[b] else a] = a if top[a] >= top[b] else b
    lab = np.array([find(i) for i in range(n + 1)])[ws]
    sizes = np.bincount(lab.ravel())[1:]
    least = settings.min_volume or max(30, int(0.02 * np.median(sizes[sizes > 30]) if (sizes > 30).any() else 30))
    lab = relabel_sequential(remove_small_objects(lab, least))[0].astype(np.int32)
    if lab.max() == 0:
        raise InputError("segment.threshold", f"no grains found above {t:g} 1/mm", "lower it")
    edge = np.zeros_like(mask)
    edge[[0, -1]] = edge[:, [0, -1]] = edge[:, :, [0, -1]] = True
    border = tuple(int(i) for i in np.unique(lab[edge]) if i)
    return Segmentation(lab, t, border)
