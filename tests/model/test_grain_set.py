"""GrainSet (`model.grains`): its arrays, removing grains, refused sets."""

import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.model.grains import Grain, GrainSet
from grainmotion.model.volume import Volume


def grain(label, voxel_size=0.1):
    return Grain(label, Volume.zeros((5, 5, 5), voxel_size), np.full(3, float(label)))


def test_labels_centers_voxel_size_and_precision():
    grains = GrainSet((grain(3), grain(7)))
    np.testing.assert_array_equal(grains.labels, [3, 7])
    np.testing.assert_array_equal(grains.centers, [[3, 3, 3], [7, 7, 7]])
    assert grains.voxel_size == 0.1
    assert grains.precision == np.float32


def test_without_removes_grains():
    grains = GrainSet((grain(3), grain(7)))
    np.testing.assert_array_equal(grains.without([0]).labels, [7])
    np.testing.assert_array_equal(grains.without([]).labels, [3, 7])
    with pytest.raises(InputError, match="no grain"):
        grains.without([0, 1])


def test_an_empty_set_is_refused():
    with pytest.raises(InputError, match="no grain"):
        GrainSet(())


def test_different_voxel_sizes_are_refused():
    with pytest.raises(InputError, match=r"voxel size.*0\.2"):
        GrainSet((grain(1), grain(2, 0.2)))


def test_a_repeated_label_is_refused():
    with pytest.raises(InputError, match="label 4 is there twice"):
        GrainSet((grain(4), grain(4)))


def test_grains_by_label_and_in_order():
    grains = GrainSet((grain(2), grain(3), grain(5), grain(4)))
    assert [grain.label for grain in grains] == grains.labels.tolist()
    assert grains[3] is grains.grains[1]
    assert grains[[4, 2]].labels.tolist() == [4, 2]
    assert grains[grains.labels[:2]].scene is grains.scene
    assert 5 in grains
    assert 6 not in grains
    with pytest.raises(InputError, match="no grain 7"):
        grains[7]
