"""Binning: radiographs, grids and geometries of larger pixels and voxels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from skimage.measure import block_reduce

from grainmotion.model.geometry import Geometry
from grainmotion.model.progress import counted
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume


def binned_images(images: NDArray, factor: int) -> NDArray[np.floating]:
    """Means over ``factor`` × ``factor`` pixels of images ``(views, rows, columns)``, which must divide by it."""
    return np.asarray(block_reduce(images, (1, factor, factor), np.mean))


def binned_grid(grid: Volume, factor: int) -> Volume:
    """An empty grid of voxels ``factor`` times as large around the same centre, not smaller than ``grid``."""
    nz, ny, nx = (-(-n // factor) for n in grid.shape)
    return Volume.zeros((nz, ny, nx), grid.voxel_size * factor, grid.center)


def binned_scan(
    scan: Scan, factor: int, views: NDArray[np.int64] | None = None, rows: tuple[int, int] | None = None
) -> Scan:
    """Radiographs of pixels ``factor`` times as large; masked pixels carry no weight.

    Parameters
    ----------
    scan : Scan
    factor : int
        Rows and columns beyond a multiple of it are left out, half on each side of the panel.
    views : (n,) int array, optional
        Views to take; by default no more than radiographs of so few columns need (`sufficient_views`).
    rows : (int, int), optional
        First of the larger rows to take and the one after the last; by default all.
    """
    height, columns = (n // factor for n in scan.geometry.shape)
    r0, c0 = ((n - m * factor) // 2 for n, m in zip(scan.geometry.shape, (height, columns), strict=True))
    views = sufficient_views(len(scan), columns) if views is None else views
    first, end = (0, height) if rows is None else rows
    geometry = binned_geometry(scan.geometry, factor, views, (first, end))
    r0, height = r0 + first * factor, end - first
    inner = (slice(r0, r0 + height * factor), slice(c0, c0 + columns * factor))
    images = (scan.line_integrals[view][inner] for view in counted(views))  # one at a time: a scan may fill the memory
    if scan.valid is None:
        means = np.empty((len(views), height, columns), scan.line_integrals.dtype)
        for mean, image in zip(means, images, strict=True):
            mean[:] = binned_images(image[None], factor)[0]
        return Scan(means, geometry)
    means, valid = np.empty((len(views), height, columns)), np.empty((len(views), height, columns), bool)
    for k, (view, image) in enumerate(zip(views, images, strict=True)):
        good = scan.valid[view][inner]
        number = block_reduce(good, (factor, factor), np.sum)
        means[k] = block_reduce(np.where(good, image, 0), (factor, factor), np.sum) / np.maximum(number, 1)
        valid[k] = number > 0
    return Scan(means, geometry, valid)


def binned_geometry(
    geometry: Geometry, factor: int, views: NDArray[np.int64], rows: tuple[int, int] | None = None
) -> Geometry:
    """The views of `binned_scan` with the same arguments."""
    height, columns = (n // factor for n in geometry.shape)
    r0, c0 = ((n - m * factor) // 2 for n, m in zip(geometry.shape, (height, columns), strict=True))
    first, end = (0, height) if rows is None else rows
    return geometry[views].window((r0 + first * factor, c0), ((end - first) * factor, columns * factor)).binned(factor)


def sufficient_views(count: int, columns: int) -> NDArray[np.int64]:
    """Evenly spaced views of ``count``, about two for each of so many columns."""
    return np.arange(0, count, max(1, round(count / (2 * columns))))


def binning_factor(shape: tuple[int, int], columns: int) -> int:
    """Factor that leaves a panel of (rows, columns) pixels about ``columns`` columns, and two rows at least."""
    return max(1, min(-(-shape[1] // columns), shape[0] // 2))


def best_factor(scan: Scan, grid: Volume, columns: tuple[int, int]) -> int:
    """Factor that leaves between two numbers of columns, as far as possible, and cuts off least of panel and grid.

    A panel or a grid that does not divide by the factor is cut or padded, and its pixels and voxels slip against each
    other by up to half a binned pixel, which doubles the residual of a sound scan.
    """
    rows, width = scan.geometry.shape
    most = max(1, rows // 2)
    lowest, highest = (min(most, max(1, -(-width // n))) for n in reversed(columns))

    def rest(factor: int) -> float:
        return sum(n % factor for n in (rows, width, *grid.shape[:2])) / factor

    return min(range(lowest, highest + 1), key=lambda factor: (round(rest(factor), 3), factor))
