"""The level of attenuation of every uniform voxel of a volume (see `uniform_cores`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from grainmotion.kernels.block_filters import erode_block, range_block, smooth_block
from grainmotion.kernels.value_histogram import count_equal_bins
from grainmotion.model.large_arrays import large_empty, large_zeros
from grainmotion.segmentation.blocks import Block, Work, blocks_of, chunks_of
from grainmotion.segmentation.blurred_gaps import is_blurred_gap
from grainmotion.segmentation.border import BeyondField
from grainmotion.segmentation.percentiles import FineBins, quantiles

Floats = NDArray[np.float32]
Codes = NDArray[np.uint8]
Counts = NDArray[np.int64]

SMOOTHING = 1.0
"""Width of the Gaussian filter before voxels are compared with their neighbours, voxels."""
MAX_RELATIVE_SPREAD = 0.12
"""Range over the 27 voxels around a uniform one, over its attenuation above air; partial volumes have more."""
NOISE_FACTOR = 4.0
"""The same in units of the lowest tenth of these ranges inside bodies, which is noise."""
MAX_STEP_SHARE = 0.25
"""Range over the 27 voxels around a uniform one, over the step to the nearest level."""
RIM = 4
"""Voxels at the border of the volume where nothing dense is looked for that is not uniform."""
DEEP = 3
"""Layers of voxels below a surface where noise is measured."""
AIR_SHARE = 0.02
"""Share of all voxels of the lowest peak, which is air (or the liquid, if there is no air)."""
LOWEST_LEVEL = 0.08
"""Lowest level of a phase, over the median level of all uniform voxels above air; artefacts of a scan lie below."""
LEVEL_BIN = 0.02
"""Width of the bins of the histogram of the logarithm of attenuation."""
LEVEL_SIGMA = 2.0
"""Width of the Gaussian filter of that histogram, bins."""
MIN_RATIO = 1.25
"""Ratio of two levels from which they are two phases: grains of one material vary by less."""
THIN_AND_DENSE = 1.4
"""Attenuation over that of the densest level from which voxels are a further level, uniform or not."""
MAX_VALLEY = 0.5
"""Voxels in the valley between two peaks over those of the lower peak."""
MIN_LEVEL_SHARE = 0.005
"""Uniform voxels of a level over those of all levels above air; gaps between grains have up to 0.003."""
MIN_PEAK_VOXELS = 20
"""Voxels of the smallest peak of that histogram."""
SAMPLE_STEP = 2
"""Every such voxel along each axis is counted for the histogram in which air is found."""
AIR_BINS = 256
"""Bins of the histogram in which air is found."""
TRUNCATE = 4.0
"""Half the reach of Gaussian filters, in their widths."""


def gaussian_weights(sigma: float) -> NDArray[np.float64]:
    """Half of the kernel of a Gaussian filter, its centre first."""
    x = np.arange(int(TRUNCATE * sigma + 0.5) + 1)
    weights = np.exp(-0.5 / (sigma * sigma) * x**2)
    return np.asarray(weights / (2 * weights.sum() - weights[0]), float)


def smoothed(array: Floats, sigma: float, work: Work) -> Floats:
    """The volume under a Gaussian filter."""
    weights, out = gaussian_weights(sigma), large_empty(array.shape, np.float32)

    def smooth(block: Block) -> None:
        out[block.box] = smooth_block(block.gather(array, len(weights) - 1), weights)

    work.each(blocks_of(array.shape), smooth)
    return out


def level_codes(
    array: Floats,
    threshold: float,
    told: Sequence[tuple[float, float]],
    beyond: BeyondField | None,
    work: Work,
) -> tuple[Codes, float, bool]:
    """Number of each uniform voxel's level from 1 on, 0 elsewhere; the range that noise causes, 1/mm; blurred gaps."""
    smooth = smoothed(array, SMOOTHING, work)
    air = _air(smooth, work)
    threshold = max(threshold - air, 0.0)
    noise = _noise(smooth, air + threshold / 4, work)
    uniform = _Uniform(smooth, air, noise)
    if told:
        return _told_codes(uniform, told, work), noise, False
    ranges = _LevelRanges.of(uniform, threshold, beyond, work)
    codes, blurred = ranges.codes(uniform, beyond, work)
    return codes, noise, blurred


@dataclass(frozen=True, eq=False)
class _Uniform:
    """Where a volume under a Gaussian filter is uniform."""

    smooth: Floats
    air: float
    noise: float

    def of(self, block: Block) -> tuple[Floats, Floats, NDArray[np.bool_]]:
        """Of the voxels of a block the rise above air, the range of 27 voxels, and whether they are uniform."""
        spread = range_block(block.gather(self.smooth, 1))
        rise = self.smooth[block.box] - np.float32(self.air)
        least = np.float32(NOISE_FACTOR * self.noise)
        return rise, spread, spread < np.maximum(np.float32(MAX_RELATIVE_SPREAD) * rise, least)


@dataclass(frozen=True, eq=False)
class _LevelRanges:
    """Attenuations above air that separate levels, and what is typical of each.

    ``bounds (k,)`` rise; level 0 lies below the first.  ``limits (k + 1,)`` are the largest ranges of 27 voxels,
    ``typical (k + 1,)`` the medians within the field of view, NaN of none.
    """

    bounds: NDArray[np.float64]
    limits: Floats
    typical: NDArray[np.float64]
    bins: FineBins

    @classmethod
    def of(cls, uniform: _Uniform, threshold: float, beyond: BeyondField | None, work: Work) -> _LevelRanges:
        """Peaks of the histogram of uniform voxels."""
        bins = FineBins.up_to(float(uniform.smooth.max()) - uniform.air)

        def count(block: Block, counts: Counts) -> Counts:
            rise, _, here = uniform.of(block)
            group = here.astype(np.int8) - np.int8(1)  # 0 if uniform
            if beyond is not None:
                group[here & beyond.of(block)] = 1
            bins.add(rise, group, counts)
            return counts

        blocks = blocks_of(uniform.smooth.shape)
        seen, smeared = np.asarray(sum(work.gathered(blocks, lambda: bins.empty(2), count)))
        noise, middle = NOISE_FACTOR * uniform.noise, bins.middle
        bright = bins.quantile(np.where(middle > max(threshold / 20, noise), seen, 0), 0.5)
        bounds = _bounds(middle, seen, max(LOWEST_LEVEL * (bright if np.isfinite(bright) else 0.0), noise / 2))
        level = np.searchsorted(bounds, middle)
        medians, typical = (
            np.array([bins.quantile(np.where(level == k, counts, 0), 0.5) for k in range(len(bounds) + 1)])
            for counts in (seen + smeared, seen)
        )
        present = np.flatnonzero(np.isfinite(medians))
        steps = np.diff(medians[present], prepend=-np.inf, append=np.inf)
        limits = np.full(len(medians), np.inf)
        limits[present] = np.maximum(MAX_STEP_SHARE * np.minimum(steps[:-1], steps[1:]), noise)
        return cls(bounds, limits.astype(np.float32), typical, bins)

    def codes(self, uniform: _Uniform, beyond: BeyondField | None, work: Work) -> tuple[Codes, bool]:
        """Number of each uniform voxel's level from 1 on, 0 of small and blurred levels, with thin and dense parts."""
        out, top = large_zeros(uniform.smooth.shape, np.uint8), len(self.bounds)

        def fill(block: Block, counts: Counts) -> Counts:
            rise, spread, here = uniform.of(block)
            level = np.zeros(rise.shape, np.int8)
            for bound in self.bounds.tolist():
                level += rise > bound
            here &= spread <= self.limits[level]  # else a bridge between two grains
            if beyond is not None:
                here &= ~self._smeared(level, rise, beyond.of(block))
            code = np.where(here, level + np.int8(1), np.int8(0))
            out[block.box] = code
            self.bins.add(rise, np.maximum(code - np.int8(2), np.int8(-1)), counts)  # air is not counted
            return counts

        counts = np.asarray(sum(work.gathered(blocks_of(out.shape), lambda: self.bins.empty(top), fill)))
        voxels, kept = counts.sum(axis=1), np.arange(top + 3, dtype=np.uint8)
        few = voxels < MIN_LEVEL_SHARE * voxels.sum()
        if top and not few.all() and voxels[-1] and not few[-1]:
            self._add_dense(out, uniform, THIN_AND_DENSE * self.bins.quantile(counts[-1], 0.5), beyond, work)
        blurred = False
        for level in np.flatnonzero(~few[:-1]).tolist():
            tenths = [self.bins.quantile(counts[level], share) for share in (0.1, 0.5, 0.9)]
            few[level] = is_blurred_gap(out, level + 2, tenths, work)
            blurred |= bool(few[level])
        kept[2:-1][few] = 0
        if few.any():
            work.each(blocks_of(out.shape), lambda block: out.__setitem__(block.box, kept[out[block.box]]))
        return out, blurred

    def _smeared(self, level: NDArray[np.int8], rise: Floats, beyond: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Voxels beyond the field of none of the levels that were found within it."""
        typical = self.typical[level]
        like = (rise > typical / MIN_RATIO) & (rise < typical * MIN_RATIO)  # not if there is none
        return np.asarray(beyond & (level > 0) & ~like)

    def _add_dense(self, codes: Codes, uniform: _Uniform, least: float, beyond: BeyondField | None, work: Work) -> None:
        """A further level of what is too thin to be uniform: a wire, a wall of metal."""
        shape, code = codes.shape, len(self.bounds) + 2

        def add(block: Block) -> None:
            dense = uniform.smooth[block.box] - np.float32(uniform.air) > least
            if dense.any():
                dense &= ~_rim(shape, block)
                if beyond is not None:
                    dense &= ~beyond.of(block)
                codes[block.box][dense] = code

        work.each(blocks_of(shape), add)


def _rim(shape: tuple[int, ...], block: Block) -> NDArray[np.bool_]:
    """Voxels at the faces and at the side of the inscribed cylinder, where what lies outside of it piles up."""
    z, y, x = (np.arange(a, b) for a, b in zip(block.start, block.stop, strict=True))
    faces = [(k < RIM) | (k >= n - RIM) for k, n in zip((z, y, x), shape, strict=True)]
    middle = [(n - 1) / 2 for n in shape]
    aside = np.hypot(y[:, None] - middle[1], x[None, :] - middle[2]) > min(shape[1:]) / 2 - RIM
    return np.asarray(faces[0][:, None, None] | faces[1][None, :, None] | faces[2][None, None, :] | aside[None])


def _told_codes(uniform: _Uniform, told: Sequence[tuple[float, float]], work: Work) -> Codes:
    """1 more than the number of the phase whose range each uniform voxel is in, or nearest to; 0 elsewhere."""
    out = large_zeros(uniform.smooth.shape, np.uint8)

    def fill(block: Block) -> None:
        here, smooth = uniform.of(block)[2], uniform.smooth[block.box]
        away = np.stack([np.maximum(low - smooth, smooth - high) for low, high in told])
        away += 1e-6 * np.stack([np.abs(smooth - (low + high) / 2) for low, high in told])  # where ranges overlap
        out[block.box] = np.where(here, away.argmin(axis=0) + 1, 0)

    work.each(blocks_of(out.shape), fill)
    return out


def _air(smooth: Floats, work: Work) -> float:
    """Attenuation of the lowest peak of the histogram that holds `AIR_SHARE` of the voxels, 1/mm."""
    sample = np.ascontiguousarray(smooth[::SAMPLE_STEP, ::SAMPLE_STEP, ::SAMPLE_STEP]).reshape(-1)
    low, high = quantiles(work, sample, [0.002, 0.998])
    if not high > low:
        return float(low)
    edges = np.histogram_bin_edges(np.zeros(0, np.float32), AIR_BINS, (low, high))

    def count(part: slice, counts: Counts) -> Counts:
        count_equal_bins(sample[part], edges, np.inf, counts)
        return counts

    counts = np.asarray(sum(work.gathered(chunks_of(sample.size), lambda: np.zeros(AIR_BINS, np.int64), count)))
    wide = ndimage.uniform_filter1d(counts.astype(float), 9, mode="constant") * 9
    peaks = np.flatnonzero((counts == ndimage.maximum_filter1d(counts, 9)) & (wide > AIR_SHARE * sample.size))
    first = int(peaks[0]) if len(peaks) else int(counts.argmax())
    return float(edges[first] + edges[first + 1]) / 2


def _noise(smooth: Floats, bodies_from: float, work: Work) -> float:
    """Lowest tenth of the ranges inside bodies, the least one of some layers of voxels below their surfaces, 1/mm."""
    bins = FineBins.up_to(float(smooth.max()) - float(smooth.min()))

    def count(block: Block, counts: Counts) -> Counts:
        bodies = (block.gather(smooth, DEEP, -np.inf) > np.float32(bodies_from)).view(np.uint8)
        if not bodies.any():
            return counts
        spread = range_block(block.gather(smooth, 1))
        depth = np.full(spread.shape, -1, np.int8)
        for layers in range(DEEP + 1):
            cut = DEEP - layers
            inner = tuple(slice(cut, n - cut) for n in bodies.shape)
            depth += bodies[inner].view(np.int8)
            bodies = erode_block(bodies) if cut else bodies
        bins.add(spread, depth, counts)
        return counts

    counts = np.asarray(sum(work.gathered(blocks_of(smooth.shape), lambda: bins.empty(DEEP + 1), count)))
    deep = np.cumsum(counts[::-1], axis=0)
    tenths = [bins.quantile(layer, 0.1) for layer in deep if layer.any()]
    return min(tenths, default=0.0)


def _bounds(rise: NDArray[np.float64], voxels: Counts, lowest: float) -> NDArray[np.float64]:
    """Attenuations above air, 1/mm, that separate the peaks of a histogram of uniform voxels, rising."""
    counted = (rise > lowest) & (voxels > 0)
    if not counted.any() or not lowest > 0:
        return np.array([np.inf])
    above, voxels = np.log(rise[counted] / lowest), voxels[counted]
    counts, edges = np.histogram(above, np.arange(0, float(above.max()) + 5 * LEVEL_BIN, LEVEL_BIN), weights=voxels)
    density = ndimage.gaussian_filter1d(counts.astype(float), LEVEL_SIGMA, mode="constant")
    around = ndimage.uniform_filter1d(counts.astype(float), 11, mode="constant") * 11
    tops = np.flatnonzero((density == ndimage.maximum_filter1d(density, 5)) & (around >= MIN_PEAK_VOXELS))
    bounds, last = [lowest], -1
    for top in tops:
        if last < 0:
            last = int(top)
            continue
        valley = last + int(density[last:top].argmin())
        apart = LEVEL_BIN * (top - last) > np.log(MIN_RATIO)
        if apart and density[valley] < MAX_VALLEY * min(density[last], density[top]):
            bounds.append(lowest * float(np.exp(edges[valley] + LEVEL_BIN / 2)))
            last = int(top)
        elif density[top] > density[last]:
            last = int(top)
    return np.array(bounds)
