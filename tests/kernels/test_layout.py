"""The table of patches: where each begins, and the patches of each view."""

import numpy as np

from grainmotion.kernels.layout import patch_table
from patch_tables import BOXES, SHAPE, TABLE


def test_offsets_add_up_the_sizes_of_patches():
    np.testing.assert_array_equal(TABLE.offsets, np.cumsum([0, 5 * 4, 8 * 6, 5 * 7, 10 * 5, 1 * 2]))


def test_every_patch_is_listed_in_its_view():
    for view in range(SHAPE[0]):
        listed = TABLE.order[TABLE.view_starts[view] : TABLE.view_starts[view + 1]]
        np.testing.assert_array_equal(listed, np.flatnonzero(BOXES[:, 1] == view))


def test_table_without_patches():
    table = patch_table(np.zeros((0, 6), np.int64), np.zeros((0, 4), np.int64), 3)
    assert table.offsets.tolist() == [0]
    assert table.view_starts.tolist() == [0, 0, 0, 0]
