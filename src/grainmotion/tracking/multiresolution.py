"""Radiographs of larger pixels and grains of larger voxels, for stages whose filter leaves nothing finer.

Under a Gaussian filter of σ pixels rays σ apart hold as much information as rays one apart, at 1/σ² of their cost;
voxels as large save as much along each ray.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Image
from grainmotion.model.scan import Scan
from grainmotion.objective.data_term import Target
from grainmotion.preprocessing.binning import binned_images
from grainmotion.projection.grain_arrays import GrainArrays, planar

MIN_FILTER_PIXELS = 1.0
"""Least width of a filter in coarse pixels."""
FIELD_GRAIN_PIXELS, FREE_GRAIN_PIXELS = 6.0, 14.0
"""Least size of a grain in coarse pixels, where all grains move with one field and where each is free."""


def coarsening(grains: GrainArrays, target: Target, sigma: float, least: float) -> int:
    """How many times larger pixels and voxels may be under a filter of ``sigma`` pixels; 1 for slices and exact paths.

    Grains stay at least ``least`` coarse pixels across.
    """
    geometry = target.scan.geometry
    if target.projector != "trilinear" or target.derivatives != "analytic" or planar(grains, geometry):
        return 1
    across = 2 * float(np.median(grains.radii)) / geometry.pixel_at(grains.centers.mean(axis=0))
    return max(1, int(min(sigma / MIN_FILTER_PIXELS, across / least)))


def coarsened(target: Target, factor: int, margin: tuple[int, int] | NDArray[np.int64] = (0, 0)) -> Target:
    """The radiographs on pixels ``factor`` times as large, with ``margin`` empty ones around the detector.

    All pixels have one weight; ``sigma`` is the same width in the new pixels.
    """
    if factor == 1 and not np.any(margin):
        return target
    geometry = target.scan.geometry
    old = np.array(geometry.shape)
    new = factor * (-(-old // factor) + 2 * np.asarray(margin))
    before = (new - old) // 2
    window = geometry.window((-before[0], -before[1]), (new[0], new[1]))
    around = [(0, 0), *((b, n - o - b) for b, n, o in zip(before, new, old, strict=True))]

    def binned(images: Image) -> Image:
        return binned_images(np.pad(images, around), factor)

    share = binned(target.valid)
    weight = np.maximum(share, 1e-6)
    images = binned(target.scan.line_integrals.astype(target.precision) * target.valid) / weight
    fixed = binned(target.fixed_background * target.valid) / weight
    scan = Scan(images, window.binned(factor), share > 0.5)
    fluid, *columns = (
        None if image is None else binned(image * target.valid) / weight
        for image in (target.fluid, *target.fluid_columns)
    )
    return replace(
        target,
        scan=scan,
        fixed_background=fixed,
        sigma=target.sigma / factor,
        weights=None,
        discount=None,
        other_squares=None,
        bodies=tuple(body.coarsened(factor) for body in target.bodies),
        fluid=fluid,
        fluid_columns=tuple(column for column in columns if column is not None),
    )
