"""Levels of attenuation in a volume, found in the insides of bodies.

Blur gives a voxel at the surface of a dense grain any attenuation between the grain's and the air's, so the histogram
of a whole volume has no clear peak for a liquid or a faint material.  Voxels whose neighbourhood is uniform are left:
the insides of bodies, one connected *core* in each, and of their histogram each peak is a phase.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

Floats = NDArray[np.float32]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int32]

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
MIN_CORE_VOXELS = 20
"""Voxels of the smallest core that makes a phase."""
SAMPLE_STEP = 2
"""Every such voxel along each axis is counted for the histogram in which air is found."""
AIR_BINS = 256
"""Bins of the histogram in which air is found."""


@dataclass(frozen=True, eq=False)
class UniformCores:
    """Cores 1 … n of a volume and their levels.

    Attributes
    ----------
    labels : (nz, ny, nx) int32 array
        0 where the volume is not uniform.
    level_of : (n + 1,) int array
        Number of the level of each core, 0 for the lowest; entry 0 is not used.
    levels : (k,) array
        Median attenuation of each level, rising, 1/mm; the first is air, or the liquid that fills all.
    noise : float
        Range of 27 smoothed neighbours that noise alone causes, 1/mm.
    smooth : (nz, ny, nx) array
        The volume under the Gaussian filter, 1/mm.
    told : tuple of int
        Of each level the number of the phase that was told.
    """

    labels: Ints
    level_of: NDArray[np.intp]
    levels: NDArray[np.float64]
    noise: float
    smooth: Floats
    told: tuple[int, ...] = ()

    @classmethod
    def of(
        cls, array: Floats, threshold: float, told: Sequence[tuple[float, float]] = (), beyond: Bools | None = None
    ) -> UniformCores:
        """The uniform cores of a volume.

        Parameters
        ----------
        array : (nz, ny, nx) array
            Attenuation, 1/mm.
        threshold : float
            Attenuation that separates bodies from air roughly, as Otsu's does, 1/mm.
        told : sequence of (float, float)
            Lowest and highest attenuation of each phase, 1/mm, if they are known.
        beyond : (nz, ny, nx) bool array, optional
            Voxels beyond the field of view.  Smeared attenuation lies there, so they make no level of their own.

        Returns
        -------
        UniformCores
            With one level if nothing rises above air.
        """
        smooth = ndimage.gaussian_filter(array, SMOOTHING, output=np.float32)
        air = _air(smooth)
        threshold = max(threshold - air, 0.0)
        spread = ndimage.maximum_filter(smooth, 3)
        spread -= ndimage.minimum_filter(smooth, 3)
        rise = smooth - air
        noise = _noise(spread, rise > threshold / 4)
        uniform = spread < np.maximum(MAX_RELATIVE_SPREAD * rise, NOISE_FACTOR * noise)
        if told:
            return cls._connected(_told_levels(smooth, uniform, told), array, noise, smooth)
        seen = uniform if beyond is None else uniform & ~beyond
        bodies = rise[seen & (rise > max(threshold / 20, NOISE_FACTOR * noise))]
        bright = float(np.median(bodies)) if len(bodies) else 0.0
        bounds = _bounds(rise[seen], max(LOWEST_LEVEL * bright, NOISE_FACTOR * noise / 2))
        level = np.searchsorted(bounds, rise).astype(np.int8)
        level[~uniform] = -1
        level[_between(level, rise, spread, NOISE_FACTOR * noise)] = -1
        if beyond is not None:
            level[_smeared(level, rise, beyond)] = -1
        counts = np.bincount(level[level > 0], minlength=len(bounds) + 1)
        level[(counts < MIN_LEVEL_SHARE * counts.sum())[level] & (level > 0)] = -1
        highest = level == len(bounds)
        if highest.any():  # what is too thin to be uniform: a wire, a wall of metal
            dense = (rise > THIN_AND_DENSE * np.median(rise[highest])) & ~_rim(array.shape)
            level[dense if beyond is None else dense & ~beyond] = len(bounds) + 1
        return cls._connected(level, array, noise, smooth)

    @classmethod
    def _connected(cls, level: NDArray[np.int8], array: Floats, noise: float, smooth: Floats) -> UniformCores:
        """From the level of each uniform voxel, -1 for others: cores, without levels that have no core."""
        labels, count = np.zeros(level.shape, np.int32), 0
        level_of, levels, told = [np.zeros(1, np.intp)], list[float](), list[int]()
        for number in range(int(level.max()) + 1):
            cores, n = ndimage.label(level == number)
            sizes = np.bincount(cores.ravel(), minlength=n + 1)
            sizes[0] = 0
            kept = np.flatnonzero(sizes >= MIN_CORE_VOXELS)
            if len(kept) == 0:
                continue
            numbers = np.zeros(n + 1, np.int32)
            numbers[kept] = count + 1 + np.arange(len(kept))
            numbers = numbers[cores]
            labels += numbers
            level_of.append(np.full(len(kept), len(levels), np.intp))
            levels.append(float(np.median(array[numbers > 0])))
            told.append(number)
            count += len(kept)
        return cls(labels, np.concatenate(level_of), np.array(levels), noise, smooth, tuple(told))


def _between(level: NDArray[np.int8], rise: Floats, spread: Floats, noise: float) -> Bools:
    """Voxels that vary by more than a part of the step to the nearest level: a bridge between two grains."""
    present = np.unique(level[level >= 0])
    values = np.array([float(np.median(rise[level == k])) for k in present])
    steps = np.diff(values, prepend=-np.inf, append=np.inf)
    limits = np.full(int(present.max(initial=0)) + 2, np.inf)  # the last for voxels of no level
    limits[present] = np.maximum(MAX_STEP_SHARE * np.minimum(steps[:-1], steps[1:]), noise)
    return np.asarray(spread > limits[level])


def _smeared(level: NDArray[np.int8], rise: Floats, beyond: Bools) -> Bools:
    """Uniform voxels beyond the field of none of the levels that were found within it."""
    smeared = beyond & (level > 0)
    for number in np.unique(level[smeared]):
        own = level == number
        within = rise[own & ~beyond]
        if len(within):
            typical = float(np.median(within))
            smeared &= ~(own & (rise > typical / MIN_RATIO) & (rise < typical * MIN_RATIO))
    return np.asarray(smeared)


def _rim(shape: tuple[int, ...]) -> Bools:
    """Voxels at the faces and at the side of the inscribed cylinder, where what lies outside of it piles up."""
    rim = np.ones(shape, bool)
    rim[tuple(slice(RIM, n - RIM) for n in shape)] = False
    y, x = (np.arange(n) - (n - 1) / 2 for n in shape[1:])
    rim[:, np.hypot(y[:, None], x[None, :]) > min(shape[1:]) / 2 - RIM] = True
    return rim


def _told_levels(smooth: Floats, uniform: Bools, told: Sequence[tuple[float, float]]) -> NDArray[np.int8]:
    """Number of the phase whose range each uniform voxel is in, or nearest to; -1 elsewhere."""
    away = np.stack([np.maximum(low - smooth, smooth - high) for low, high in told])
    away += 1e-6 * np.stack([np.abs(smooth - (low + high) / 2) for low, high in told])  # where ranges overlap
    return np.where(uniform, away.argmin(axis=0), -1).astype(np.int8)


def _air(smooth: Floats) -> float:
    """Attenuation of the lowest peak of the histogram that holds `AIR_SHARE` of the voxels, 1/mm."""
    sample = smooth[::SAMPLE_STEP, ::SAMPLE_STEP, ::SAMPLE_STEP]
    low, high = np.percentile(sample, [0.2, 99.8])
    if not high > low:
        return float(low)
    counts, edges = np.histogram(sample, AIR_BINS, (low, high))
    wide = ndimage.uniform_filter1d(counts.astype(float), 9, mode="constant") * 9
    peaks = np.flatnonzero((counts == ndimage.maximum_filter1d(counts, 9)) & (wide > AIR_SHARE * sample.size))
    first = int(peaks[0]) if len(peaks) else int(counts.argmax())
    return float(edges[first] + edges[first + 1]) / 2


def _noise(spread: Floats, bodies: Bools) -> float:
    """Lowest tenth of the ranges inside bodies, 1/mm."""
    ranges = []
    for layers in range(DEEP + 1):
        deep = ndimage.binary_erosion(bodies, iterations=layers) if layers else bodies
        if deep.any():
            ranges.append(float(np.percentile(spread[deep], 10)))
    return min(ranges, default=0.0)


def _bounds(rise: NDArray[np.floating], lowest: float) -> NDArray[np.float64]:
    """Attenuations above air, 1/mm, that separate the peaks of the histogram of uniform voxels, rising."""
    above = rise[rise > lowest]
    if len(above) == 0 or not lowest > 0:
        return np.array([np.inf])
    above = np.log(above / lowest)
    counts, edges = np.histogram(above, np.arange(0, float(above.max()) + 5 * LEVEL_BIN, LEVEL_BIN))
    density = ndimage.gaussian_filter1d(counts.astype(float), LEVEL_SIGMA, mode="constant")
    around = ndimage.uniform_filter1d(counts.astype(float), 11, mode="constant") * 11
    tops = np.flatnonzero((density == ndimage.maximum_filter1d(density, 5)) & (around >= MIN_CORE_VOXELS))
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
