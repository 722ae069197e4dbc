"""Kernels compiled, or loaded from the cache, before the first state arrives: a few grains tracked on small images."""

from __future__ import annotations

import numpy as np

from grainmotion.backends.base import PatchBackend
from grainmotion.experiment.inputs import Inputs
from grainmotion.model.geometry import Geometry
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.scan import Scan
from grainmotion.projection.grains import simulate_radiographs
from grainmotion.tracking.settings import TrackSettings
from grainmotion.tracking.track import track

WARM_UP_GRAINS, WARM_UP_VIEWS, WARM_UP_PIXELS = 7, 3, 128
"""Grains, views and greatest width of the images; from 6 grains on the smooth field is affine."""


def warm_up(grains: GrainSet, inputs: Inputs, settings: TrackSettings, backend: PatchBackend | None) -> None:
    """Track a few grains that did not move, with the settings of a run; nothing is kept."""
    few = grains.without(range(WARM_UP_GRAINS, len(grains))) if len(grains) > WARM_UP_GRAINS else grains
    if not len(few):
        return
    geometry = _views(inputs)
    still = Motions.identity(few.labels, few.centers)
    images = simulate_radiographs(few, still, geometry)
    noise = 0.01 * float(images.max(initial=0.0)) * np.random.default_rng(0).standard_normal(images.shape)
    scan = Scan((images + noise).astype(np.float32), geometry)
    track(few, scan, (None, still), settings, device=backend)


def _views(inputs: Inputs) -> Geometry:
    """Some views of the reference scan on coarse pixels, or parallel ones of a given volume."""
    scan, grid = inputs.reference or inputs.volume_scan, inputs.grid
    if scan is None:
        shape = grid.shape[0], max(grid.shape[1:])
        geometry = Geometry.parallel([0.0, 55.0, 110.0], shape, grid.voxel_size)
    else:
        count = len(scan.geometry)
        geometry = scan.geometry[np.unique(np.arange(WARM_UP_VIEWS) * count // (2 * WARM_UP_VIEWS))]
    factor = -(-max(geometry.shape) // WARM_UP_PIXELS)
    if factor == 1:
        return geometry
    rows, columns = (max(1, n // factor) * factor for n in geometry.shape)
    return geometry.window((0, 0), (rows, columns)).binned(factor)
