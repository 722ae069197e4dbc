"""Voxels of a grain kept line by line: whole numbers from the first to the last voxel of each line that is not zero."""

from __future__ import annotations

import numba as nb
import numpy as np

from grainmotion.kernels.compilation import CACHE


@nb.njit(cache=CACHE, error_model="numpy")
def write_lines(values, zero, firsts, ends, unit, length, out):
    """Fill ``out``, lines of ``length`` voxels, with ``unit`` times ``values − zero``, which follow line after line.

    Those of line k are its voxels ``firsts[k]`` to ``ends[k]``; all others are zero.
    """
    at = 0
    for k in range(len(firsts)):
        first, end = int(firsts[k]), int(ends[k])
        line = out[k * length : (k + 1) * length]
        line[:first] = 0
        for c in range(first, end):
            line[c] = unit * np.float32(int(values[at + c - first]) - zero)
        line[end:] = 0
        at += end - first
