"""The benchmark of a watch: packings of each kind lie in the field of view as they should."""

import numpy as np
import pytest
from validation.benchmarks.watch import KINDS, MARGIN, VOXEL, packing


@pytest.mark.parametrize("name", ["convex-20", "ellipsoids-22", "tall-20"])
def test_only_the_tall_packing_goes_beyond_the_field(name):
    sample, (rows, columns) = packing(KINDS[name], 5, seed=0)
    outlines = np.concatenate([p.shape.outline for p in sample.particles])
    border = rows / 2 * VOXEL
    assert outlines[:, 2].min() == pytest.approx(MARGIN * VOXEL - border, abs=VOXEL)
    assert (outlines[:, 2].max() > border) == KINDS[name].tall
    assert np.linalg.norm(outlines[:, :2], axis=1).max() < (columns - MARGIN) / 2 * VOXEL
