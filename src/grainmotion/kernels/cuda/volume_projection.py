"""Whole volumes on the GPU: line integrals, their exact adjoint, and one update of SART.

A thread traces one ray.  Threads of a warp take neighbouring rows of one column of a panel, and the volume lies
with z fastest: on an upright panel they then read neighbouring voxels at every step, at all angles.  `axes_renamed`
names the axes anew (x y z ← z x y, rows ↔ columns), so that `kernels.ray_tracing` serves here, too.
Any other panel is served alike, only slower.

The adjoint adds by atomic operations: which of two rays adds first is not the same in every run, and sums differ
by rounding.
"""

from __future__ import annotations

from types import FunctionType

import numpy as np
from numba import cuda, float64

from grainmotion.kernels import volume_projection
from grainmotion.kernels.cuda.device_array import MAX_BLOCKS, SIMULATED, THREADS, empty, on_gpu, upload
from grainmotion.kernels.ray_tracing import enter, line_integral, pixel_ray
from grainmotion.kernels.sart import chord

BEAM = (2, 2) if SIMULATED else (32, 4)
"""Rays of a block along the rows and columns of a panel, as many as THREADS."""


# ---------------------------------------------------------------------- z fastest
def axes_renamed(vectors, origin):
    """Views and the position of voxel [0, 0, 0] with axes named anew, for volumes and images of `z_fastest`."""
    blocks = vectors.reshape(-1, 4, 3)[:, [0, 1, 3, 2]][:, :, [2, 0, 1]]
    return np.ascontiguousarray(blocks.reshape(-1, 12)), np.asarray(origin)[[2, 0, 1]]


def z_fastest(volume):
    """A volume ``[z, y, x]`` of the host on the GPU as ``[y, x, z]``."""
    return upload(volume.transpose(1, 2, 0))


def x_fastest(volume):
    """The host's ``[z, y, x]`` of a volume on the GPU."""
    return np.ascontiguousarray(volume.host.transpose(2, 0, 1))


def swapped(images):
    """Images ``(n, rows, columns)`` of the host or the GPU with rows and columns swapped, on the GPU."""
    n, rows, columns = images.shape
    out = empty((n, columns, rows), images.dtype)
    _swap[_grid(n, columns, rows), BEAM](on_gpu(images), out.array)
    return out


# ---------------------------------------------------------------------- A, Aᵀ and SART; axes as `axes_renamed`
def forward(image, origin, voxel, views, cone, exact, out):
    """Line integrals ``out (views, columns, rows)`` of a volume with z fastest."""
    n, columns, rows = out.shape
    _forward[_grid(n, columns, rows), BEAM](
        image.array.reshape(-1), *image.shape, on_gpu(origin), 1.0 / voxel, on_gpu(views), cone, exact, out.array
    )
    out.changed()


def adjoint(images, origin, voxel, views, cone, exact, which, out):
    """Add the exact adjoint of `forward` for the views ``which`` of ``views``, applied to their images."""
    n, columns, rows = images.shape
    _adjoint[_grid(n, columns, rows), BEAM](
        images.array, *out.shape, on_gpu(origin), 1.0 / voxel, on_gpu(views), on_gpu(which), cone, exact,
        out.array.reshape(-1),
    )  # fmt: skip
    out.changed()


def corrections(image, origin, voxel, views, cone, exact, radius, measured, valid, which, step, out):
    """step · (b − A x)/(A 1) of the views ``which`` in ``out (len(which), columns, rows)``; see `kernels.sart`.

    ``views``, ``measured`` and ``valid`` are of the whole scan.  Returns Σ(b − A x)² and Σb² of each block of rays,
    ``(len(which), blocks, 2)`` on the GPU: nothing waits for them here.
    """
    n, columns, rows = out.shape
    grid = _grid(n, columns, rows)
    squares = empty((n, grid[0] * grid[1], 2), np.float64)
    _residual[grid, BEAM](
        image.array.reshape(-1), *image.shape, on_gpu(origin), voxel, on_gpu(views), cone, exact, radius,
        measured.array, valid.array, on_gpu(which), step, out.array, squares.array,
    )  # fmt: skip
    out.changed()
    return squares


def constrain(image, padding, radius, lowest):
    """Zero a volume's padding and what lies beyond its cylinder; raise the rest to ``lowest``."""
    _constrain[_blocks(image), THREADS](image.array.reshape(-1), *image.shape, padding, radius, lowest)
    image.changed()


def constrain_and_extrapolate(image, before, padding, radius, lowest, momentum):
    """`constrain` a x, then go on: x + momentum · (x − before), with x left in ``before``."""
    _constrain_and_extrapolate[_blocks(image), THREADS](
        image.array.reshape(-1), before.array.reshape(-1), *image.shape, padding, radius, lowest, momentum
    )
    image.changed()
    before.changed()


def _blocks(image):
    return min(-(-int(np.prod(image.shape)) // THREADS), MAX_BLOCKS)


def _grid(views, columns, rows):
    return -(-rows // BEAM[0]), -(-columns // BEAM[1]), views


# ---------------------------------------------------------------------- kernels; x y z are renamed
@cuda.jit(device=True)
def _atomic_add(image, index, value):
    cuda.atomic.add(image, index, value)


def _for_many(function):
    """A scattering function of `kernels.volume_projection`, from the same source, for threads that share voxels."""
    source = getattr(function, "py_func", function)
    return cuda.jit(device=True)(FunctionType(source.__code__, {**source.__globals__, "add_to": _atomic_add}))


_scatter_smooth = _for_many(volume_projection.scatter_smooth)
_scatter_exact = _for_many(volume_projection.scatter_exact)


@cuda.jit
def _swap(images, out):
    r, c = cuda.grid(2)
    i = cuda.blockIdx.z
    if c < out.shape[1] and r < out.shape[2]:
        out[i, c, r] = images[i, r, c]


@cuda.jit
def _forward(image, nz, ny, nx, origin, h, views, cone, exact, out):
    c, r = cuda.grid(2)
    i = cuda.blockIdx.z
    if r < out.shape[1] and c < out.shape[2]:
        px, py, pz, dx, dy, dz = pixel_ray(views[i], cone, r - (out.shape[1] - 1) / 2, c - (out.shape[2] - 1) / 2)
        o = ((px - origin[0]) * h, (py - origin[1]) * h, (pz - origin[2]) * h)
        out[i, r, c] = line_integral(image, (nz, ny, nx), o, (dx * h, dy * h, dz * h), exact)


@cuda.jit
def _adjoint(images, nz, ny, nx, origin, h, views, which, cone, exact, image):
    c, r = cuda.grid(2)
    k = cuda.blockIdx.z
    i = which[k]
    if r < images.shape[1] and c < images.shape[2]:
        value = images[k, r, c]
        if value != 0:
            px, py, pz, dx, dy, dz = pixel_ray(
                views[i], cone, r - (images.shape[1] - 1) / 2, c - (images.shape[2] - 1) / 2
            )
            _, first, count, oa, ob, oc, da, db, dc, sa, sb, sc = enter(
                (px - origin[0]) * h, (py - origin[1]) * h, (pz - origin[2]) * h,
                dx * h, dy * h, dz * h, nx, ny, nz, exact,
            )  # fmt: skip
            if exact:
                _scatter_exact(image, value, first, count, oa, ob, oc, da, db, dc, sa, sb, sc)
            else:
                _scatter_smooth(image, value, first, count, oa, ob, oc, da, db, dc, sa, sb, sc)


@cuda.jit
def _residual(image, nz, ny, nx, origin, voxel, views, cone, exact, radius, measured, valid, which, step, out,
              squares):  # fmt: skip
    c, r = cuda.grid(2)
    k = cuda.blockIdx.z
    i = which[k]
    misfit, norm = 0.0, 0.0
    if r < out.shape[1] and c < out.shape[2]:
        h = 1.0 / voxel
        px, py, pz, dx, dy, dz = pixel_ray(views[i], cone, r - (out.shape[1] - 1) / 2, c - (out.shape[2] - 1) / 2)
        ox, oy, oz = (px - origin[0]) * h, (py - origin[1]) * h, (pz - origin[2]) * h
        length = chord(oy, oz, ox, dy * h, dz * h, dx * h, ny, nz, nx, radius)
        correction = 0.0
        if length > 0 and valid[i, r, c]:
            value = measured[i, r, c]
            difference = value - line_integral(image, (nz, ny, nx), (ox, oy, oz), (dx * h, dy * h, dz * h), exact)
            misfit, norm = difference * difference, float64(value) * value
            correction = step * difference / max(length, 4 * voxel)
        out[k, r, c] = correction
    parts = cuda.shared.array((2, THREADS), float64)
    me = cuda.threadIdx.y * cuda.blockDim.x + cuda.threadIdx.x
    parts[0, me], parts[1, me] = misfit, norm
    cuda.syncthreads()
    half = THREADS // 2
    while half > 0:
        if me < half:
            parts[0, me] += parts[0, me + half]
            parts[1, me] += parts[1, me + half]
        cuda.syncthreads()
        half //= 2
    if me < 2:
        squares[k, cuda.blockIdx.y * cuda.gridDim.x + cuda.blockIdx.x, me] = parts[me, 0]


@cuda.jit(device=True)
def _inside(at, nz, ny, nx, padding, radius):
    """Whether a voxel lies within the volume's padding and its upright cylinder (if ``radius`` > 0)."""
    z, y, x = at // (ny * nx), at // nx % ny, at % nx
    if min(x, y, z) < padding or max(x - nx, y - ny, z - nz) >= -padding:
        return False
    dy, dz = y - (ny - 1) / 2, z - (nz - 1) / 2
    return radius == 0 or dy * dy + dz * dz <= radius * radius


@cuda.jit
def _constrain(image, nz, ny, nx, padding, radius, lowest):
    for at in range(cuda.grid(1), len(image), cuda.gridsize(1)):
        image[at] = max(image[at], lowest) if _inside(at, nz, ny, nx, padding, radius) else 0


@cuda.jit
def _constrain_and_extrapolate(image, before, nz, ny, nx, padding, radius, lowest, momentum):
    for at in range(cuda.grid(1), len(image), cuda.gridsize(1)):
        if _inside(at, nz, ny, nx, padding, radius):
            value = max(image[at], lowest)
            image[at] = value + momentum * (value - before[at])
            before[at] = value
        else:
            image[at] = 0
