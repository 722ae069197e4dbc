"""Size of grains in a later state against a volume with wrong voxels."""

from __future__ import annotations

import pytest

from convex_grains import VOXEL, ConvexGrains
from grainmotion.diagnosis.grain_scale import grain_scale, scale_notes
from grainmotion.model.motions import Motions
from grainmotion.model.volume import Volume
from grainmotion.segmentation.extraction import grains_from_labels


@pytest.mark.parametrize("error", [-0.02, 0.0, 0.02])
def test_size_is_found_whatever_the_place(error):
    """Grains of a volume with other voxels, put where the radiographs have them."""
    sample = ConvexGrains.random(6, 9)
    volume, labels = sample.voxels()
    right = grains_from_labels(volume, labels)
    given = grains_from_labels(Volume(volume.array, VOXEL * (1 + error)), labels)
    motions = Motions.identity(labels=[g.label for g in given.grains], centers=given.centers)
    motions.translations[:] = right.centers - given.centers
    scan = sample.scan()
    size, residual, least = grain_scale(given, motions, scan)
    assert size * (1 + error) == pytest.approx(1, abs=0.004)
    assert least <= residual
    notes = scale_notes(given, motions, scan)
    assert len(notes) == (error != 0)
    assert all("voxel size" in note for note in notes)
