"""Colours of statuses: readers with any kind of colour vision tell them apart."""

import itertools

import numpy as np
import pytest
from skimage.color import rgb2lab

from grainmotion.model.status import STATUS_COLOURS, Status

# linear RGB as seen without one kind of cone: Machado, Oliveira and Fernandes, IEEE TVCG 15(6), 2009, severity 1
VISION = {
    "all cones": np.eye(3),
    "no green": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "no red": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "no blue": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}
LEAST_DIFFERENCE = 14  # in CIELAB; 2 is just noticeable, side by side


def test_every_status_has_a_colour():
    assert set(STATUS_COLOURS) == {status.value for status in Status}


@pytest.mark.parametrize("kind", VISION)
def test_statuses_differ(kind):
    encoded = np.array([[int(c[i : i + 2], 16) / 255 for i in (1, 3, 5)] for c in STATUS_COLOURS.values()])
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    seen = np.clip(linear @ np.transpose(VISION[kind]), 0, 1)
    seen = np.where(seen <= 0.0031308, 12.92 * seen, 1.055 * seen ** (1 / 2.4) - 0.055)
    lab = rgb2lab(seen[None])[0]
    for (i, a), (j, b) in itertools.combinations(enumerate(STATUS_COLOURS), 2):
        assert np.linalg.norm(lab[i] - lab[j]) > LEAST_DIFFERENCE, (a, b)
