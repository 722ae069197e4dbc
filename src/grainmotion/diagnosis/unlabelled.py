"""Attenuation that no label holds and that looks like grains, as of a second, fainter material."""

from __future__ import annotations

from dataclasses import dataclass

import edt
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from grainmotion.model.finding import Check, Finding, Level
from grainmotion.model.volume import Volume
from grainmotion.segmentation.distance_basins import distance_basins
from grainmotion.segmentation.region_merging import BasinGraph
from grainmotion.segmentation.settings import SegmentSettings

UNLABELLED_CHECK: Check = "unlabelled"
BLOB_LEVEL = 0.1
"""Attenuation from which a smoothed voxel may belong to a fainter grain, from air (0) to the mean of the grains (1)."""
BLOB_NOISE = 4.0
"""The same in robust standard deviations of the smoothed voxels outside the labels."""
BLOB_SIGMA = 1.0
"""Width of the Gaussian filter over voxels without a label."""
BLOB_GAP = 2.0
"""Distance from the labels within which attenuation is their blurred surface, voxels."""
MIN_BLOB_RADIUS = 0.5
"""Radius of the largest ball in a blob, over that of the median grain."""
BLOB_VOLUMES = (0.15, 6.0)
"""Volume of a blob, over that of the median grain."""
MAX_BLOB_SPREAD = 7.0
"""Volume of a blob over that of its largest ball: compact as grains are, not walls or liquid in pores."""
MIN_BLOB_AIR = 0.5
"""Share of a blob's surface on air: the rest of a liquid lies on grains."""
MIN_BLOB_ATTENUATION = 0.01
"""Attenuation of all blobs over that of the volume, from which a warning is given."""
MIN_GRAIN_OVER_THRESHOLD = 1.3
"""Mean attenuation of a grain over the threshold: 1.8 and more in samples of one material (stones of 10 to 32 voxels),
1.05 to 1.08 in pieces of grains of 0.4 of the others' attenuation.
"""
MIN_OTHER_GRAINS = 4
"""Grains beside the largest from which their sizes are compared."""
MAX_SHARE_OF_A_GRAIN = 0.5
"""Share of all labelled voxels in one grain."""
MAX_GRAIN = 30.0
"""Volume of the largest grain over that of the median of the others; a sample of 10 to 32 voxels has 8."""


@dataclass(frozen=True)
class Blobs:
    """Blobs of attenuation without a label.

    Attributes
    ----------
    count : int
    share : float
        Of all attenuation.
    level : float
        Median attenuation, 1/mm.
    threshold : float
        Threshold that would make grains of them, 1/mm; NaN if it would label other things as well.
    """

    count: int
    share: float
    level: float
    threshold: float


def check_unlabelled(
    volume: Volume, labels: NDArray[np.integer], where: str = "segment.threshold"
) -> tuple[Finding, ...]:
    """Findings about attenuation that a segmentation, or given labels, left out.

    Parameters
    ----------
    volume : Volume
        Attenuation, 1/mm.
    labels : (nz, ny, nx) int array
        Grains, 0 for none.
    where : str
        Key, for the finding.

    Returns
    -------
    tuple of Finding
        Empty if all blobs of attenuation are labelled.
    """
    blobs = unlabelled_blobs(volume, labels)
    if blobs is None or blobs.share < MIN_BLOB_ATTENUATION:
        return ()
    are = (
        "1 blob of attenuation that looks like a grain has"
        if blobs.count == 1
        else (f"{blobs.count} blobs of attenuation that look like grains have")
    )
    fact = f"{are} no label and will be in no table: a fainter material?"
    evidence = f"{blobs.share:.0%} of all attenuation, at {blobs.level:.3g} 1/mm"
    remedy = (
        "lower [segment] threshold" if np.isnan(blobs.threshold) else f"[segment] threshold = {blobs.threshold:.3g}"
    )
    return (Finding(Level.WARNING, UNLABELLED_CHECK, where, fact, evidence, remedy),)


def unlabelled_blobs(volume: Volume, labels: NDArray[np.integer]) -> Blobs | None:
    """Blobs outside the labels as large and compact as grains, surrounded by air; None if there is none."""
    array, whole = volume.array, float(volume.array.sum(dtype=float))
    if min(volume.shape) == 1 or not labels.any() or whole <= 0 or (labels > 0).all():
        return None
    outside = labels == 0
    grain, dark = float(array[~outside].mean()), float(np.median(array[outside]))
    smooth = ndimage.gaussian_filter(np.where(outside, array, dark), BLOB_SIGMA)
    far = edt.edt(outside, parallel=1) > BLOB_GAP
    if not far.any() or grain <= dark:
        return None
    middle = float(np.median(smooth[far]))
    noise = 1.4826 * float(np.median(np.abs(smooth[far] - middle)))
    mask = far & (smooth > max(dark + BLOB_LEVEL * (grain - dark), middle + BLOB_NOISE * noise))
    distance = edt.edt(mask, parallel=1)
    sizes = np.bincount(labels.ravel())[1:]
    sizes = sizes[sizes > 0]
    ball = float(np.median(np.cbrt(3 * sizes / (4 * np.pi))))
    if float(distance.max()) < MIN_BLOB_RADIUS * ball:
        return None
    settings = SegmentSettings()
    basins = distance_basins(distance)
    parts = BasinGraph.of(distance, basins).merged(settings.depth, settings.oneness)[basins]
    median, solid, accepted = float(np.median(sizes)), mask | ~outside, []
    for k, box in enumerate(ndimage.find_objects(parts), start=1):
        if box is None or any(s.start == 0 or s.stop == n for s, n in zip(box, parts.shape, strict=True)):
            continue
        wide = tuple(slice(s.start - 1, s.stop + 1) for s in box)
        if _is_blob(parts[wide] == k, distance[wide], solid[wide], median, ball):
            accepted.append(k)
    if not accepted:
        return None
    chosen = np.isin(parts, accepted)
    level = float(np.median(smooth[chosen]))
    threshold = dark + (level - dark) / 2
    rest = far & ~ndimage.binary_dilation(chosen, iterations=int(BLOB_GAP) + 1)
    clear = not rest.any() or np.count_nonzero(smooth[rest] > threshold) < 0.1 * np.count_nonzero(chosen)
    share = float(array[chosen].sum(dtype=float)) / whole
    return Blobs(len(accepted), share, level, threshold if clear else float("nan"))


def _is_blob(
    own: NDArray[np.bool_], distance: NDArray[np.floating], solid: NDArray[np.bool_], median: float, ball: float
) -> bool:
    """Whether a part is as large and compact as a grain, and lies in air; all arrays are cut to it and a rim."""
    size, radius = np.count_nonzero(own), float(distance[own].max())
    if not BLOB_VOLUMES[0] * median <= size <= BLOB_VOLUMES[1] * median or radius < MIN_BLOB_RADIUS * ball:
        return False
    if size > MAX_BLOB_SPREAD * 4 / 3 * np.pi * radius**3:
        return False
    surface = ndimage.binary_dilation(own) & ~own
    return bool(np.mean(~solid[surface]) >= MIN_BLOB_AIR)


def check_grain_sizes(labels: NDArray[np.integer], where: str = "segment.threshold") -> tuple[Finding, ...]:
    """A finding about one label that holds most of what is labelled, and is no grain among others.

    Parameters
    ----------
    labels : (nz, ny, nx) int array
        Grains, 0 for none.
    where : str
        Key, for the finding.

    Returns
    -------
    tuple of Finding
        At most one.
    """
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    others = np.delete(sizes, sizes.argmax())
    others = others[others > 0]
    share = float(sizes.max() / sizes.sum()) if sizes.any() else 0.0
    if len(others) < MIN_OTHER_GRAINS or share < MAX_SHARE_OF_A_GRAIN or sizes.max() < MAX_GRAIN * np.median(others):
        return ()
    fact = "one grain is far larger than all others: a container, a liquid, or grains that were not separated"
    evidence = f"label {sizes.argmax()} holds {share:.0%} of all labelled voxels"
    remedy = "check the labels; a higher [segment] threshold leaves out a liquid, a lower oneness separates more"
    return (Finding(Level.WARNING, "grain-sizes", where, fact, evidence, remedy),)


def check_fragments(
    volume: Volume, labels: NDArray[np.integer], threshold: float, where: str = "segment.threshold"
) -> tuple[Finding, ...]:
    """A finding about labels that hardly exceed the threshold: it cuts through grains of a fainter material.

    Parameters
    ----------
    volume : Volume
        Attenuation, 1/mm.
    labels : (nz, ny, nx) int array
        Grains found by the threshold, 0 for none.
    threshold : float
        Attenuation from which a voxel is grain, 1/mm; NaN if there was none.
    where : str
        Key, for the finding.

    Returns
    -------
    tuple of Finding
        At most one.
    """
    present = np.flatnonzero(np.bincount(labels.ravel()))
    present = present[present > 0]
    if not threshold > 0 or len(present) < 2:
        return ()
    means = np.asarray(ndimage.mean(volume.array, labels, present))
    faint = means < MIN_GRAIN_OVER_THRESHOLD * threshold
    if not faint.any() or faint.all():
        return ()
    level = float(means[faint].mean())
    fact = f"{np.count_nonzero(faint)} of {len(present)} grains hardly exceed the threshold: pieces of fainter grains"
    evidence = f"their mean attenuation is {level:.3g}, the threshold {threshold:.3g}, 1/mm"
    remedy = f"lower it, to about half of the fainter grains' attenuation: [segment] threshold = {level / 2:.3g}"
    return (Finding(Level.WARNING, UNLABELLED_CHECK, where, fact, evidence, remedy),)
