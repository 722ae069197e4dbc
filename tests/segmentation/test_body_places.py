"""Where bodies lie against the grains, from counts of voxels."""

import numpy as np
import pytest

from grainmotion.segmentation.body_places import GrainsExtent

SHAPE = (40, 30, 34)
Z, Y, X = np.indices(SHAPE)
GRAINS = (abs(Z - 20) < 12) & (np.hypot(Y - 14, X - 18) < 9)


def test_extent_is_that_of_all_voxels():
    extent = GrainsExtent.of(GRAINS.astype(np.int32))
    z, y, x = np.nonzero(GRAINS)
    assert (extent.low, extent.high) == tuple(np.percentile(z, [2, 98]))
    assert extent.middle == pytest.approx((y.mean(), x.mean()))
    assert extent.radius == pytest.approx(np.percentile(np.hypot(y - y.mean(), x - x.mean()), 80))


@pytest.mark.parametrize(
    ("place", "body"),
    [
        ("above", Z > 33),
        ("below", Z < 6),
        ("around", abs(np.hypot(Y - 14, X - 18) - 12) < 1.5),
        ("beside", (np.hypot(Y - 14, X - 30) < 3) & (abs(Z - 20) < 8)),
    ],
)
def test_places(place, body):
    assert GrainsExtent.of(GRAINS.astype(np.int32)).place((0, 0, 0), body) == place
    inner = tuple(slice(int(p.min()), int(p.max()) + 1) for p in np.nonzero(body))
    assert GrainsExtent.of(GRAINS.astype(np.int32)).place(tuple(s.start for s in inner), body[inner]) == place


def test_no_grains():
    assert GrainsExtent.of(np.zeros(SHAPE, np.int32)) is None
