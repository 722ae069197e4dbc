"""Attenuation that no label holds and that looks like grains, as of a second, fainter material."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import edt
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from grainmotion._typing import Image
from grainmotion.model.finding import Check, Finding, Level
from grainmotion.model.label_sums import label_sizes, label_sums, mean_of_labels
from grainmotion.model.large_arrays import large_empty
from grainmotion.model.progress import counted
from grainmotion.model.quantiles import median_of_labels, quantile_of_parts
from grainmotion.model.slabs import slabs
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
BLOB_GAP = 2
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

Box = tuple[slice, slice, slice]


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
    sizes = label_sizes(labels)[1:]
    sizes = sizes[sizes > 0]
    if min(volume.shape) == 1 or not sizes.size or whole <= 0 or sizes.sum() == labels.size:
        return None
    dark = median_of_labels(labels, array, 0)
    step = mean_of_labels(labels, array) - dark
    if step <= 0:
        return None
    smooth = _smooth_far(array, labels, dark)
    middle = quantile_of_parts(lambda: map(_known, counted(smooth)), 0.5)
    if np.isnan(middle):
        return None
    noise = 1.4826 * quantile_of_parts(lambda: (np.abs(_known(plane) - middle) for plane in counted(smooth)), 0.5)
    mask = smooth > max(dark + BLOB_LEVEL * step, middle + BLOB_NOISE * noise)
    del smooth  # made again in the rare case that there is a blob
    median, ball = float(np.median(sizes)), float(np.median(np.cbrt(3 * sizes / (4 * np.pi))))
    if not _holds_a_ball(mask, MIN_BLOB_RADIUS * ball):
        return None
    blobs = list(_blobs(mask, labels, median, ball))
    if not blobs:
        return None
    smooth = _smooth_far(array, labels, dark)
    level = float(np.median(np.concatenate([smooth[box][own] for box, own in blobs])))
    threshold = dark + (level - dark) / 2
    reach, size = BLOB_GAP + 1, sum(np.count_nonzero(own) for _, own in blobs)
    for box, own in blobs:
        wide = tuple(slice(max(s.start - reach, 0), s.stop + reach) for s in box)
        inside = np.zeros(smooth[wide].shape, bool)
        inside[tuple(slice(s.start - w.start, s.stop - w.start) for s, w in zip(box, wide, strict=True))] = own
        smooth[wide][ndimage.binary_dilation(inside, iterations=reach)] = np.nan
    clear = sum(np.count_nonzero(plane > threshold) for plane in smooth) < 0.1 * size
    share = sum(float(array[box][own].sum(dtype=float)) for box, own in blobs) / whole
    return Blobs(len(blobs), share, level, threshold if clear else float("nan"))


def _smooth_far(array: Image, labels: NDArray[np.integer], dark: float) -> Image:
    """Voxels without a label under a Gaussian filter, NaN near the labels; some planes at a time."""
    out = large_empty(array.shape, array.dtype)
    margin = max(int(4 * BLOB_SIGMA + 0.5), BLOB_GAP + 1)
    for around, inner in slabs(len(array), margin):
        outside = labels[around] == 0
        smooth = ndimage.gaussian_filter(np.where(outside, array[around], dark), BLOB_SIGMA)
        smooth[_near(~outside)] = np.nan
        out[around.start + inner.start : around.start + inner.stop] = smooth[inner]
    return out


def _near(solid: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Voxels within a ball of `BLOB_GAP`, two, voxels around those of a mask: the mask moved over its offsets."""
    row = _with_moved(solid, solid, 2, 1)
    square = _with_moved(row, row, 1, 1)
    disk = _with_moved(_with_moved(square, solid, 2, 2), solid, 1, 2)
    return _with_moved(_with_moved(disk, square, 0, 1), solid, 0, 2)


def _with_moved(mask: NDArray[np.bool_], other: NDArray[np.bool_], axis: int, step: int) -> NDArray[np.bool_]:
    """A mask, and another moved by so many voxels either way."""
    out = mask.copy()
    to, of = np.moveaxis(out, axis, 0), np.moveaxis(other, axis, 0)
    to[step:] |= of[:-step]
    to[:-step] |= of[step:]
    return out


def _holds_a_ball(mask: NDArray[np.bool_], radius: float) -> bool:
    """Whether any voxel of a mask is so far from all voxels outside of it; some planes at a time."""
    for around, inner in slabs(len(mask), int(radius) + 1):
        if mask[around][inner].any() and float(edt.edt(mask[around], parallel=1)[inner].max()) >= radius:
            return True
    return False


def _known(plane: Image) -> Image:
    """Pixels that are not NaN."""
    return plane[~np.isnan(plane)]


def _blobs(
    mask: NDArray[np.bool_], labels: NDArray[np.integer], median: float, ball: float
) -> Iterator[tuple[Box, NDArray[np.bool_]]]:
    """Boxes of the parts of a mask that are as large and compact as grains and lie in air, and their voxels therein.

    Each connected piece is divided by itself, as grains are by `segment`.
    """
    settings, shape = SegmentSettings(), mask.shape
    pieces, _ = ndimage.label(mask, np.ones((3, 3, 3)))
    for piece, place in enumerate(ndimage.find_objects(pieces), start=1):
        around = tuple(slice(max(s.start - 1, 0), s.stop + 1) for s in place)
        own = pieces[around] == piece
        if np.count_nonzero(own) < BLOB_VOLUMES[0] * median:
            continue
        distance, solid = edt.edt(own, parallel=1), own | (labels[around] > 0)
        basins = distance_basins(distance)
        parts = BasinGraph.of(distance, basins).merged(settings.depth, settings.oneness)[basins]
        for k, part in enumerate(ndimage.find_objects(parts), start=1):
            z, y, x = (slice(s.start + w.start, s.stop + w.start) for s, w in zip(part, around, strict=True))
            box = z, y, x
            if any(s.start == 0 or s.stop == n for s, n in zip(box, shape, strict=True)):
                continue
            wide = tuple(slice(s.start - 1, s.stop + 1) for s in part)
            if _is_blob(parts[wide] == k, distance[wide], solid[wide], median, ball):
                yield box, parts[part] == k


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
    sizes = label_sizes(labels)
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
    if not threshold > 0:
        return ()
    sizes = label_sizes(labels)
    present = 1 + np.flatnonzero(sizes[1:])
    if len(present) < 2:
        return ()
    means = label_sums(labels, volume.array)[present] / sizes[present]
    faint = means < MIN_GRAIN_OVER_THRESHOLD * threshold
    if not faint.any() or faint.all():
        return ()
    level = float(means[faint].mean())
    fact = f"{np.count_nonzero(faint)} of {len(present)} grains hardly exceed the threshold: pieces of fainter grains"
    evidence = f"their mean attenuation is {level:.3g}, the threshold {threshold:.3g}, 1/mm"
    remedy = f"lower it, to about half of the fainter grains' attenuation: [segment] threshold = {level / 2:.3g}"
    return (Finding(Level.WARNING, UNLABELLED_CHECK, where, fact, evidence, remedy),)
