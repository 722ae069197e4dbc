"""Which labels are no grains (`segmentation.large_bodies`): typical sizes without the one that is judged."""

import numpy as np

from grainmotion.segmentation.large_bodies import large_bodies, typical, typical_of_others


def test_what_is_typical_of_all_others():
    rng = np.random.default_rng(0)
    for count in (2, 3, 10, 41):
        values, volumes = rng.normal(size=count), rng.uniform(1, 30, count) ** 2
        expected = [typical(np.delete(values, k), np.delete(volumes, k)) for k in range(count)]
        np.testing.assert_array_equal(typical_of_others(values, volumes), expected)
    assert np.isnan(typical_of_others(np.ones(1), np.ones(1))).all()


def test_a_piston_and_its_fragment_are_no_grains():
    labels = np.zeros((30, 40, 40), np.int32)
    labels[:3] = 1
    labels[3, 5:8, 5:8] = 2  # lies on it
    for label, x in enumerate((2, 14, 26), start=3):
        labels[12:22, 10:20, x : x + 10] = label
    assert large_bodies(labels) == (1, 2)
    labels[:4] = 0
    assert large_bodies(labels) == ()
