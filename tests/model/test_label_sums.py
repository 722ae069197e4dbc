"""Numbers of labels, plane by plane."""

import numpy as np
import pytest

from grainmotion.model.label_sums import label_sizes, label_sums, mean_of_labels


@pytest.fixture(scope="module")
def labelled():
    rng = np.random.default_rng(0)
    labels = rng.integers(0, 7, (5, 6, 4)).astype(np.int32)
    labels[labels == 4] = 0
    labels[0] = 0  # planes have different highest labels
    return labels, rng.normal(1, 1, labels.shape).astype(np.float32)


def test_sizes_and_sums_are_those_of_the_whole_volume(labelled):
    labels, values = labelled
    np.testing.assert_array_equal(label_sizes(labels), np.bincount(labels.ravel()))
    np.testing.assert_allclose(label_sums(labels, values), np.bincount(labels.ravel(), values.ravel()))
    assert mean_of_labels(labels, values) == pytest.approx(values[labels > 0].mean())


def test_more_labels_than_there_are(labelled):
    assert label_sizes(labelled[0], 12).shape == (12,)


def test_no_labels():
    labels = np.zeros((2, 3, 4), np.int32)
    assert label_sizes(labels).tolist() == [24]
    assert mean_of_labels(labels, np.ones(labels.shape)) == 0
