"""Disjoint sets, as of connected voxels: each member points to another one of its set, the root to itself."""

from __future__ import annotations

import numba as nb

from grainmotion.kernels.compilation import CACHE


@nb.njit(cache=CACHE, nogil=True)
def root_of(parents, member):
    """The root of a member's set; the way to it gets shorter for later calls."""
    while parents[member] != member:
        parents[member] = parents[parents[member]]
        member = parents[member]
    return member
