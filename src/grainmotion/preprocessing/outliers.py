"""Pixels that contradict their neighbours in the image or do not change from view to view.

A spike (a zinger, a hot or an insensitive pixel) covers at most 2 x 2 pixels, so that the 16 pixels around its 5 x 5
surroundings do not hold it, while an edge, a rod or a gap between two grains does pass through them.  A spike is
brighter than the brightest, or darker than the darkest, of those 16 by far more than noise; beyond that it has to be
brighter than air, or to differ by a factor that no grain of this size has.  Whole columns and rows are compared with
those at both sides.  All decisions but that of `stuck_pixels` are made image by image.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from grainmotion.kernels.outliers import mark_spikes

Mask = NDArray[np.bool_]
Transmission = NDArray[np.float32]

SPIKE_SIGMAS = 6.0
"""Distance of a spike from its surroundings in standard deviations of the noise."""
BRIGHT_RATIO = 2.0
"""A spike that is darker than air has at least this ratio to the brightest of its surroundings."""
DARK_RATIO = 0.2
"""A dark spike has at most this ratio to the darkest of its surroundings."""
AIR_PERCENTILE = 90.0
"""Percentile of an image's transmission that stands for air; a few hot columns lie above it."""
LINE_SHARE = 0.5
"""Share of the pixels of a line that are outliers; more make the whole line one."""
CONSTANT_SHARE = 0.8
"""Share of neighbours along a line with equal values; more make the line a stuck one."""
MAX_CONSTANT_LINES = 0.05
"""Share of the lines of an image that may be stuck; more are an image without noise."""
MAX_LINES_TOGETHER = 3
"""Stuck lines side by side."""
MAX_STUCK_SHARE = 0.1
"""Share of the pixels of most columns or rows that may be stuck; more are images without noise."""
MAX_CHANCE_OF_STUCK = 1e-5
"""Probability that a pixel has one value in all views by chance; above it stuck pixels are not looked for."""
QUIET_PERCENTILE, QUIET_SIGMAS = 25.0, 0.319
"""Percentile of the differences between two images that stands for noise, and that of a normal distribution."""
MIN_SIDE = 8
"""Rows and columns of an image; a smaller one has too few neighbours to judge by."""
SAMPLED_VIEWS = 16
"""Views of a scan in which stuck pixels and the top of the camera's range are looked for."""
CAMERA_TOPS = {(2.0**bits - 1) * 2.0**shift: 2.0**shift for bits in (8, 10, 12, 14) for shift in {0, 16 - bits}}
"""Largest values of cameras, and the distance of values there."""
MIN_PILE, MIN_PILE_SHARE, PILE_RATIO = 50, 1e-3, 3.0
"""Least number of pixels with the largest value, their least share, and their number over that of the next values."""
MAX_NOISE_SAMPLE = 1 << 16
"""Pixels from which the noise and the level of air of an image are estimated."""


def spikes(transmission: Transmission, good: Mask) -> Mask:
    """Spikes and outlying columns and rows of one radiograph.

    Parameters
    ----------
    transmission : (rows, columns) float32 array
        I/I0.
    good : (rows, columns) bool array
        Pixels known to be bad are left alone and are nobody's neighbours.

    Returns
    -------
    (rows, columns) bool array
        True where a pixel must not be used.
    """
    if min(transmission.shape) < MIN_SIDE:
        return np.zeros(transmission.shape, dtype=bool)
    image = transmission if good.all() else np.where(good, transmission, np.float32(0))
    noise = SPIKE_SIGMAS * _noise(image)
    air = max(1.0, float(np.percentile(_thinned(image), AIR_PERCENTILE)))
    found = np.zeros(image.shape, dtype=bool)
    lines = np.zeros((2, max(image.shape), 2), dtype=np.int64)
    mark_spikes(image, (noise, air + noise * np.sqrt(air), BRIGHT_RATIO, DARK_RATIO), found, lines)
    rows, columns = image.shape
    found[:, lines[1, :columns].max(axis=1) > LINE_SHARE * rows] = True
    found[lines[0, :rows].max(axis=1) > LINE_SHARE * columns] = True
    return found & good


def constant_lines(raw: NDArray) -> Mask:
    """Up to three columns or rows of one raw image whose pixels have one value, while those at both sides differ."""
    found = np.zeros(raw.shape, dtype=bool)
    if min(raw.shape) < MIN_SIDE:
        return found
    for axis in (0, 1):
        along = np.moveaxis(raw, axis, 0)
        lines = (along[1:] == along[:-1]).mean(axis=0) > CONSTANT_SHARE
        if lines.any() and lines.mean() <= MAX_CONSTANT_LINES:
            found |= np.expand_dims(lines & ~_wide(lines), axis)
    return found


def _wide(lines: Mask) -> Mask:
    """Lines that touch the border of the image or more than two others, as air does in images without noise."""
    ends = np.flatnonzero(np.diff(np.concatenate([[False], lines, [False]]).astype(int)))
    wide = np.zeros_like(lines)
    for first, end in zip(ends[::2], ends[1::2]):
        wide[first:end] = end - first > MAX_LINES_TOGETHER or first == 0 or end == len(lines)
    return wide


def stuck_pixels(raw: NDArray) -> Mask:
    """Pixels with one value in all of several views, while their neighbours change.

    Parameters
    ----------
    raw : (views, rows, columns) array
        Images as the camera gave them, from all over the scan.

    Returns
    -------
    (rows, columns) bool array
        True where a pixel is stuck; nowhere if equal values could be chance, as in images without noise.
    """
    same = np.ones(raw.shape[1:], dtype=bool)
    chances = []
    for former, image in itertools.pairwise(raw):
        equal = image == former
        same &= equal
        lines = min(float(np.median(equal.mean(axis=axis))) for axis in (0, 1))
        chances.append(max(lines, _chance_of_equal(image, former)))
    chance = max(chances, default=1.0) ** (len(raw) - 1) if len(raw) > 1 else 1.0
    share = max(float(np.median(same.mean(axis=axis))) for axis in (0, 1))
    if chance > MAX_CHANCE_OF_STUCK or share > MAX_STUCK_SHARE or not same.any():
        return np.zeros(raw.shape[1:], dtype=bool)
    return same & ~_areas(same)


def _chance_of_equal(image: NDArray, former: NDArray) -> float:
    """Probability that a pixel of noise has one value in two images, from how much most pixels differ."""
    differences = np.abs(_thinned(image).astype(float) - _thinned(former))
    changed = differences[differences > 0]
    if not len(changed):
        return 1.0
    spread = float(np.percentile(differences, QUIET_PERCENTILE)) / QUIET_SIGMAS
    return min(1.0, float(changed.min()) / max(np.sqrt(2 * np.pi) * spread, 1e-12))


def _areas(same: Mask) -> Mask:
    """Pixels of areas too wide for stuck lines, or along a border: air in images without noise."""
    labels, _ = ndimage.label(same, np.ones((3, 3), int))
    side = MAX_LINES_TOGETHER + 1
    wide = set(np.unique(labels[ndimage.binary_erosion(same, np.ones((side, side), bool))]))
    for border in (labels[0], labels[-1], labels[:, 0], labels[:, -1]):
        numbers, counts = np.unique(border, return_counts=True)
        wide |= set(numbers[counts > LINE_SHARE * len(border)])
    return np.isin(labels, list(wide - {0}))


@dataclass(frozen=True, eq=False)
class PanelFacts:
    """What some views of a scan show about the panel.

    Attributes
    ----------
    stuck : (rows, columns) bool array
        Pixels that do not change.
    top : float, optional
        Count at the top of the camera's range where many pixels have it, below the largest value of the number type.
    """

    stuck: Mask
    top: float | None = None


def sample_views(count: int) -> NDArray[np.int_]:
    """Views, from all over a scan of ``count``, in which the panel is judged."""
    return np.unique(np.linspace(0, count - 1, min(count, SAMPLED_VIEWS)).round().astype(int))


def panel_facts(images: NDArray, flats: NDArray | None = None) -> PanelFacts:
    """Judge the panel by all views of a scan, or by the sample of them.

    Parameters
    ----------
    images : (views, rows, columns) array
        Images as the camera gave them.
    flats : (n, rows, columns) array, optional
        Likewise, of the open beam.

    Returns
    -------
    PanelFacts
        Stuck pixels, and the top of the camera's range.
    """
    sample = images[sample_views(len(images))]
    return PanelFacts(stuck_pixels(sample), pile_up([sample] if flats is None else [sample, flats]))


def pile_up(stacks: list[NDArray]) -> float | None:
    """The largest value of 8, 10, 12 or 14 bits, if it is the largest of all and many pixels have it.

    Bits may be shifted to the upper end of 16 bits.  The count just below is rarer by far, as no image of a beam with
    noise has it.
    """
    highest = max(float(np.nanmax(stack, initial=0)) for stack in stacks)
    if highest not in CAMERA_TOPS:
        return None
    step = CAMERA_TOPS[highest]
    if all(np.issubdtype(stack.dtype, np.integer) and np.iinfo(stack.dtype).max <= highest for stack in stacks):
        return None
    total = sum(stack.size for stack in stacks)
    numbers = [sum(int(np.count_nonzero(stack == highest - k * step)) for stack in stacks) for k in range(4)]
    if numbers[0] < max(MIN_PILE, MIN_PILE_SHARE * total, PILE_RATIO * max(numbers[1:])):
        return None
    return highest


def _noise(image: Transmission) -> float:
    """Standard deviation of the noise where the transmission is 1, if its variance is proportional to it."""
    step = max(1, image.size // MAX_NOISE_SAMPLE)
    rows = image[::step]
    level = (rows[:, 1:] + rows[:, :-1]) / 2
    lit = level > 0
    if not lit.any():
        return 0.0
    steps = np.abs(np.diff(rows, axis=1))[lit] / np.sqrt(level[lit])
    return float(1.4826 * np.median(steps) / np.sqrt(2))


def _thinned(image: Transmission) -> Transmission:
    step = max(1, int(np.sqrt(image.size / MAX_NOISE_SAMPLE)))
    return image[::step, ::step]
