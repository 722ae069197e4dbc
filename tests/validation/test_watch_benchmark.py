"""The benchmark of a watch: packings of each kind lie in the field of view as they should."""

import numpy as np
import pytest
from validation.benchmarks.watch import KINDS, MARGIN, VOXEL, packing, scanner_of


@pytest.mark.parametrize("name", ["convex-20", "ellipsoids-22", "tall-20"])
def test_only_the_tall_packing_goes_beyond_the_field(name):
    sample, (rows, columns) = packing(KINDS[name], 5, seed=0)
    outlines = np.concatenate([p.shape.outline for p in sample.particles])
    border = rows / 2 * VOXEL
    assert outlines[:, 2].min() >= MARGIN * VOXEL - border - VOXEL
    assert (outlines[:, 2].max() > border) == KINDS[name].tall
    assert np.linalg.norm(outlines[:, :2], axis=1).max() < (columns - MARGIN) / 2 * VOXEL


def test_every_view_sees_the_whole_of_a_high_packing():
    sample, panel = packing(KINDS["convex-40"], 60, seed=0)
    points = np.concatenate([p.shape.outline for p in sample.particles])
    pixels = scanner_of(panel).geometry().project_points(points)
    assert pixels.min() > 0
    assert (pixels[..., 0].max(), pixels[..., 1].max()) < (panel[0] - 1, panel[1] - 1)
    assert pixels[..., 0].min() < 2 * MARGIN  # the margin is not wider than it needs to be
