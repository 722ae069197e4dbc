"""Connected components of voxels, made of runs: stretches of a row of voxels that are wanted.

A volume has far fewer runs than voxels, so that components need little memory beside it.  Rows are ``[z, y]`` in turn;
the runs of row r are ``offsets[r]`` … ``offsets[r + 1]``.  Voxels are neighbours if they share a face.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from grainmotion.kernels.compilation import CACHE
from grainmotion.kernels.disjoint_sets import root_of


@nb.njit(cache=CACHE, nogil=True)
def count_runs(codes: np.ndarray, flip: int, first: int, last: int, counts: np.ndarray) -> None:
    """Runs of equal codes other than zero in each row of the planes ``first`` … ``last``.

    With ``flip`` 1 the zeros of a mask are counted instead.
    """
    _, ny, nx = codes.shape
    for z in range(first, last):
        for y in range(ny):
            row = codes[z, y]
            before, found = 0, 0
            for x in range(nx):
                code = row[x] ^ flip
                if code != before and code != 0:
                    found += 1
                before = code
            counts[z * ny + y] = found


@nb.njit(cache=CACHE, nogil=True)
def write_runs(
    codes: np.ndarray,
    flip: int,
    first: int,
    last: int,
    offsets: np.ndarray,
    starts: np.ndarray,
    stops: np.ndarray,
    parents: np.ndarray,
) -> None:
    """Where the runs of these planes start and stop, and the first run that each is connected to within them."""
    _, ny, nx = codes.shape
    for z in range(first, last):
        for y in range(ny):
            row, r = codes[z, y], z * ny + y
            run, before = offsets[r] - 1, 0
            for x in range(nx):
                code = row[x] ^ flip
                if code != before:
                    if before != 0:
                        stops[run] = x
                    if code != 0:
                        run += 1
                        starts[run] = x
                        parents[run] = run
                before = code
            if before != 0:
                stops[run] = nx
            if y > 0:
                _join_rows(codes, flip, r, r - 1, offsets, starts, stops, parents)
            if z > first:
                _join_rows(codes, flip, r, r - ny, offsets, starts, stops, parents)


@nb.njit(cache=CACHE, nogil=True)
def join_planes(
    codes: np.ndarray,
    flip: int,
    plane: int,
    offsets: np.ndarray,
    starts: np.ndarray,
    stops: np.ndarray,
    parents: np.ndarray,
) -> None:
    """Connect the runs of a plane with those of the plane below."""
    ny = codes.shape[1]
    for y in range(ny):
        _join_rows(codes, flip, plane * ny + y, (plane - 1) * ny + y, offsets, starts, stops, parents)


@nb.njit(cache=CACHE, nogil=True)
def number_components(parents: np.ndarray) -> int:
    """Replace each run's parent by the number of its component, 0 … n - 1 by their first runs; returns n."""
    count = 0
    for run in range(len(parents)):
        if parents[run] == run:
            parents[run] = count
            count += 1
        else:
            parents[run] = parents[parents[run]]  # the parent comes before, so it holds its number
    return count


@nb.njit(cache=CACHE, nogil=True)
def measure_components(
    shape: tuple[int, int, int],
    offsets: np.ndarray,
    starts: np.ndarray,
    stops: np.ndarray,
    component: np.ndarray,
    sizes: np.ndarray,
    at_border: np.ndarray,
    places: np.ndarray,
) -> None:
    """Voxels of each component, whether it reaches a face of the volume, and the place of its first voxel."""
    nz, ny, nx = shape
    for r in range(nz * ny):
        z, y = r // ny, r % ny
        edge = z == 0 or z == nz - 1 or y == 0 or y == ny - 1
        for run in range(offsets[r], offsets[r + 1]):
            if sizes[component[run]] == 0:
                places[component[run]] = r * np.int64(nx) + starts[run]
            sizes[component[run]] += stops[run] - starts[run]
            if edge or starts[run] == 0 or stops[run] == nx:
                at_border[component[run]] = True


@nb.njit(cache=CACHE, nogil=True)
def mark_components(
    mask: np.ndarray,
    offsets: np.ndarray,
    starts: np.ndarray,
    stops: np.ndarray,
    component: np.ndarray,
    marked: np.ndarray,
) -> None:
    """Mark the components of which any voxel is in a mask."""
    _, ny, _ = mask.shape
    for r in range(len(offsets) - 1):
        row = mask[r // ny, r % ny]
        for run in range(offsets[r], offsets[r + 1]):
            if not marked[component[run]]:
                for x in range(starts[run], stops[run]):
                    if row[x]:
                        marked[component[run]] = True
                        break


@nb.njit(cache=CACHE, nogil=True)
def paint_components(
    out: np.ndarray,
    first: int,
    last: int,
    offsets: np.ndarray,
    starts: np.ndarray,
    stops: np.ndarray,
    component: np.ndarray,
    values: np.ndarray,
) -> None:
    """Write the value of each component into its voxels, in the planes ``first`` … ``last``; not where that is 0."""
    ny = out.shape[1]
    for r in range(first * ny, last * ny):
        row = out[r // ny, r % ny]
        for run in range(offsets[r], offsets[r + 1]):
            value = values[component[run]]
            if value != 0:
                row[starts[run] : stops[run]] = value


@nb.njit(cache=CACHE, nogil=True)
def _join_rows(codes, flip, here, there, offsets, starts, stops, parents):
    """Connect the overlapping runs of two rows."""
    ny = codes.shape[1]
    a, b = offsets[here], offsets[there]
    while a < offsets[here + 1] and b < offsets[there + 1]:
        if stops[a] <= starts[b]:
            a += 1
            continue
        if stops[b] <= starts[a]:
            b += 1
            continue
        if codes[here // ny, here % ny, starts[a]] == codes[there // ny, there % ny, starts[b]]:
            one, other = root_of(parents, a), root_of(parents, b)
            if one < other:
                parents[other] = one
            else:
                parents[one] = other
        if stops[a] <= stops[b]:
            a += 1
        else:
            b += 1
