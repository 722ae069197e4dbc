"""Where labels lie best on a volume: correlations at shifts, and offsets of fractions of a voxel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from grainmotion._typing import Float

MIN_OFFSET_SIGNAL = 0.05
"""Attenuation gained by moving the labels by a voxel, half of the difference to the other direction, over the step
from air to grains at each of their faces: below it nothing is told, as labels may end within the grains.

Measured on packings, sharp, blurred by 1.2 voxels and with noise of 15 %: 0.01 at most for labels eroded by 2 and 3
voxels or dilated by 2, of which the offset is any number; 0.126 at least for labels off by 0.6 voxel.
"""


def correlation(a: NDArray, b: NDArray) -> float:
    """Correlation of two arrays of the same shape; 0 if one is constant."""
    a, b = a - a.mean(), b - b.mean()
    norm = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float((a * b).sum()) / norm if norm > 0 else 0.0


def best_shift(array: NDArray, mask: NDArray) -> tuple[float, tuple[int, int, int]]:
    """Correlation at the best shift of ``array`` against ``mask``, and that shift."""
    a, b = array - array.mean(), mask - mask.mean()
    norm = float(np.linalg.norm(a) * np.linalg.norm(b))
    if norm == 0:
        return 0.0, (0, 0, 0)
    products = fft.irfftn(np.conj(fft.rfftn(a)) * fft.rfftn(b), s=a.shape)
    place = np.unravel_index(int(products.argmax()), a.shape)
    shift = [int((p + n // 2) % n - n // 2) for p, n in zip(place, a.shape, strict=True)]
    return float(products.max()) / norm, (shift[0], shift[1], shift[2])


def small_offset(array: NDArray[np.floating], labels: NDArray[np.integer], step: float) -> Float:
    """Offset of the labels along z, y, x, voxels, from the attenuation one voxel ahead and behind; 0 if untold."""
    offsets = np.zeros(3)
    mask = labels > 0
    here = float(array[mask].sum(dtype=float))
    for axis in range(3):
        ahead, behind = (_sum_at(array, mask, axis, step) for step in (-1, 1))
        bend = 2 * here - ahead - behind
        faces = np.count_nonzero(np.diff(mask, axis=axis))
        if bend > 0 and abs(ahead - behind) / 2 > MIN_OFFSET_SIGNAL * step * faces:
            offsets[axis] = float(np.clip(0.5 * (ahead - behind) / bend, -1, 1))
    return offsets


def _sum_at(array: NDArray[np.floating], mask: NDArray[np.bool_], axis: int, step: int) -> float:
    """Attenuation in the mask moved by one voxel along an axis."""
    first = [slice(None)] * 3
    second = [slice(None)] * 3
    first[axis] = slice(1, None) if step > 0 else slice(None, -1)
    second[axis] = slice(None, -1) if step > 0 else slice(1, None)
    return float(array[tuple(first)][mask[tuple(second)]].sum(dtype=float))
