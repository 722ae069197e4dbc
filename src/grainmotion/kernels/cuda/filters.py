"""Gaussian filters on the GPU; see `kernels.filters`."""

from __future__ import annotations

from numba import cuda

from grainmotion.kernels.cuda.device_array import MAX_BLOCKS, TILE, download, empty, on_gpu


def filter_images(images, weights):
    """Filter ``images (n, rows, columns)`` of the host in place."""
    n, rows, columns = images.shape
    if not images.size:
        return
    image, work, kernel = on_gpu(images), empty(images.shape, images.dtype).array, on_gpu(weights)
    grid = (min(-(-columns // TILE[0]), MAX_BLOCKS), min(-(-rows // TILE[1]), MAX_BLOCKS), n)
    _along_rows[grid, TILE](image, work, kernel)
    _along_columns[grid, TILE](work, image, kernel)
    download(image, images)


def filter_patches(derivatives, patches, factor, weights):
    """Multiply ``derivatives (k, pixels)``, on the GPU, by ``factor (views, rows, columns)``, filter each patch."""
    each, pixels = derivatives.shape
    if pixels:
        tables = on_gpu(patches.boxes), on_gpu(patches.offsets), on_gpu(factor), on_gpu(weights)
        work = empty((each, pixels if len(weights) > 1 else 1), derivatives.dtype)
        _filter_patches[(len(patches.boxes), each), TILE](derivatives.array, work.array, *tables)
    derivatives.changed()


@cuda.jit
def _along_rows(image, out, weights):
    left, top = cuda.grid(2)
    right, down = cuda.gridsize(2)
    i, reach = cuda.blockIdx.z, len(weights) - 1
    for r in range(top, image.shape[1], down):
        for c in range(left, image.shape[2], right):
            total = weights[0] * image[i, r, c]
            for k in range(1, reach + 1):
                if c >= k:
                    total += weights[k] * image[i, r, c - k]
                if c + k < image.shape[2]:
                    total += weights[k] * image[i, r, c + k]
            out[i, r, c] = total


@cuda.jit
def _along_columns(image, out, weights):
    left, top = cuda.grid(2)
    right, down = cuda.gridsize(2)
    i, reach = cuda.blockIdx.z, len(weights) - 1
    for r in range(top, image.shape[1], down):
        for c in range(left, image.shape[2], right):
            total = weights[0] * image[i, r, c]
            for k in range(1, reach + 1):
                if r >= k:
                    total += weights[k] * image[i, r - k, c]
                if r + k < image.shape[1]:
                    total += weights[k] * image[i, r + k, c]
            out[i, r, c] = total


@cuda.jit
def _filter_patches(derivatives, work, boxes, offsets, valid, weights):
    """One patch of one derivative a block: masked, then along its rows to ``work``, then along its columns."""
    p, each = cuda.blockIdx.x, cuda.blockIdx.y
    i, r0, c0 = boxes[p, 1], boxes[p, 2], boxes[p, 4]
    rows, columns = boxes[p, 3] - r0, boxes[p, 5] - c0
    reach, start = len(weights) - 1, offsets[p]
    for r in range(cuda.threadIdx.y, rows, cuda.blockDim.y):
        for c in range(cuda.threadIdx.x, columns, cuda.blockDim.x):
            derivatives[each, start + r * columns + c] *= valid[i, r0 + r, c0 + c]
    if reach == 0:
        return
    cuda.syncthreads()
    for r in range(cuda.threadIdx.y, rows, cuda.blockDim.y):
        row = start + r * columns
        for c in range(cuda.threadIdx.x, columns, cuda.blockDim.x):
            total = weights[0] * derivatives[each, row + c]
            for k in range(1, reach + 1):
                if c >= k:
                    total += weights[k] * derivatives[each, row + c - k]
                if c + k < columns:
                    total += weights[k] * derivatives[each, row + c + k]
            work[each, row + c] = total
    cuda.syncthreads()
    for r in range(cuda.threadIdx.y, rows, cuda.blockDim.y):
        for c in range(cuda.threadIdx.x, columns, cuda.blockDim.x):
            at = start + r * columns + c
            total = weights[0] * work[each, at]
            for k in range(1, reach + 1):
                if r >= k:
                    total += weights[k] * work[each, at - k * columns]
                if r + k < rows:
                    total += weights[k] * work[each, at + k * columns]
            derivatives[each, at] = total
