"""The cubic spline through the voxels of a crop, sampled on finer voxels.

Samples fall on a few phases between voxels, so that along each axis a sample is a short weighted sum of the spline's
coefficients.  At the edges everything is mirrored.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from grainmotion.kernels.compilation import CACHE

_POLE = np.sqrt(3.0) - 2
_DECAY = 24
"""Voxels over which the powers of the pole fall below single precision."""


@nb.njit(cache=CACHE, nogil=True)
def to_coefficients(values: np.ndarray) -> None:
    """Replace voxels by the coefficients of the B-splines whose sum goes through them."""
    nz, ny, nx = values.shape
    for z in range(nz):
        _filter_lines(values[z])
        for y in range(ny):
            _filter_lines(values[z, y].reshape(nx, 1))
    for y in range(ny):
        _filter_lines(values[:, y])


@nb.njit(cache=CACHE, nogil=True)
def _filter_lines(values):
    """Filter along the first axis, forth and back (Unser et al. 1993), many lines at once."""
    n, columns = values.shape
    pole, gain = values.dtype.type(_POLE), values.dtype.type((1 - _POLE) * (1 - 1 / _POLE))
    if n == 1:
        return
    start = np.zeros(columns, values.dtype)  # what comes before the first one, mirrored
    factor = values.dtype.type(1)
    for k in range(_DECAY):
        place = k % (2 * n)
        factor *= pole
        line = values[min(place, 2 * n - 1 - place)]
        for c in range(columns):
            start[c] += factor * line[c]
    for c in range(columns):
        values[0, c] = gain * (values[0, c] + start[c])
    for k in range(1, n):
        before, line = values[k - 1], values[k]
        for c in range(columns):
            line[c] = gain * line[c] + pole * before[c]
    last, factor = values[n - 1], pole / (pole - values.dtype.type(1))
    for c in range(columns):
        last[c] *= factor
    for k in range(n - 2, -1, -1):
        after, line = values[k + 1], values[k]
        for c in range(columns):
            line[c] = pole * (after[c] - line[c])


@nb.njit(cache=CACHE, nogil=True)
def sample(coefficients: np.ndarray, weights: np.ndarray, box: np.ndarray) -> np.ndarray:
    """Samples of the voxels of a box.

    Parameters
    ----------
    coefficients : (nz, ny, nx) array
        Of `to_coefficients`.
    weights : (f, 2 r + 1) array
        Of the coefficients ``-r … r`` voxels away, for each of f samples to a voxel; in the same precision.
    box : (3, 2) int array
        First and last (excluded) voxel along z, y, x.

    Returns
    -------
    (f nz, f ny, f nx) array
        Of the box.
    """
    phases, taps = weights.shape
    reach = taps // 2
    sizes = box[:, 1] - box[:, 0]
    dtype = coefficients.dtype
    rows = np.empty((sizes[1] + 2 * reach, sizes[2] + 2 * reach), dtype)
    along_y = np.empty((phases * sizes[1], sizes[2] + 2 * reach), dtype)
    out = np.empty((phases * sizes[0], phases * sizes[1], phases * sizes[2]), dtype)
    columns = np.empty(sizes[2] + 2 * reach, np.int64)
    for i in range(len(columns)):
        columns[i] = _mirrored(box[2, 0] - reach + i, coefficients.shape[2])
    inside = box[2, 0] >= reach and box[2, 1] + reach <= coefficients.shape[2]
    line = np.empty(len(columns), dtype)
    for z in range(phases * sizes[0]):
        for j in range(len(rows)):
            y = _mirrored(box[1, 0] - reach + j, coefficients.shape[1])
            row = rows[j]
            row[:] = 0
            for k in range(taps):
                weight = weights[z % phases, k]
                if weight == 0:
                    continue
                plane = _mirrored(box[0, 0] + z // phases + k - reach, coefficients.shape[0])
                source = coefficients[plane, y]
                if inside:
                    part = source[box[2, 0] - reach : box[2, 1] + reach]
                    for i in range(len(row)):
                        row[i] += weight * part[i]
                else:
                    for i in range(len(row)):
                        row[i] += weight * source[columns[i]]
        for y in range(phases * sizes[1]):
            row = along_y[y]
            row[:] = 0
            for k in range(taps):
                weight, source = weights[y % phases, k], rows[y // phases + k]
                for i in range(len(row)):
                    row[i] += weight * source[i]
            for phase in range(phases):
                for i in range(sizes[2]):
                    line[i] = 0
                for k in range(taps):
                    weight, part = weights[phase, k], row[k : k + sizes[2]]
                    for i in range(sizes[2]):
                        line[i] += weight * part[i]
                target = out[z, y]
                for i in range(sizes[2]):
                    target[phases * i + phase] = line[i]
    return out


@nb.njit(cache=CACHE, nogil=True)
def _mirrored(place, n):
    """A place in a line of n that goes on as its own mirror image."""
    place %= 2 * n
    return min(place, 2 * n - 1 - place)
