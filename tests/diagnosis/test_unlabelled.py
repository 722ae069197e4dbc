"""Attenuation without a label that looks like grains, and what is none."""

from __future__ import annotations

import numpy as np
import pytest

from convex_grains import VOXEL, ConvexGrains
from grainmotion.diagnosis.unlabelled import check_fragments, check_grain_sizes, check_unlabelled, unlabelled_blobs
from grainmotion.model.volume import Volume


def two_materials(seed, faint, count=3):
    """A volume whose last grains are fainter and have no label, with noise."""
    grains = ConvexGrains.random(seed, 12)
    grains.attenuations[12 - count :] *= faint
    volume, labels = grains.voxels()
    noise = np.random.default_rng(seed).normal(0, 0.008, volume.shape).astype(np.float32)
    return Volume(volume.array + noise, VOXEL), np.where(labels > 12 - count, 0, labels) if count else labels


@pytest.mark.parametrize("faint", [0.25, 0.4])
def test_grains_of_a_fainter_material(faint):
    volume, labels = two_materials(1, faint)
    blobs = unlabelled_blobs(volume, labels)
    assert blobs.count == 3
    assert 0.05 * faint * 0.15 < blobs.threshold < faint * 0.15
    (finding,) = check_unlabelled(volume, labels)
    assert f"[segment] threshold = {blobs.threshold:.3g}" in finding.remedy


def test_all_grains_labelled():
    volume, labels = ConvexGrains.random(2, 12).voxels()
    assert check_unlabelled(volume, labels) == ()


def test_walls_pistons_and_liquids_are_no_grains():
    volume, labels = ConvexGrains.random(2, 9).voxels()
    z, y, x = np.indices(volume.shape) - (np.array(volume.shape).reshape(3, 1, 1, 1) - 1) / 2
    radius = np.hypot(y, x)
    wall = np.where((radius > 16.5) & (radius < 19.5), 0.07, 0)
    piston = np.where((np.abs(z) > 18.5) & (radius < 16), 0.2, 0)
    liquid = np.where((radius < 16.5) & (labels == 0), 0.06, 0)
    for body in (wall, piston, liquid, wall + liquid):
        assert check_unlabelled(Volume(np.maximum(volume.array, body), VOXEL), labels) == ()


def test_one_label_that_holds_nearly_all():
    labels = ConvexGrains.random(2, 9).voxels()[1]
    assert check_grain_sizes(labels) == ()
    assert len(check_grain_sizes(np.where(labels == 0, 10, labels))) == 1


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(20))
def test_seeds(seed):
    volume, labels = two_materials(seed, 0.3)
    assert unlabelled_blobs(volume, labels).count == 3
    volume, labels = two_materials(seed, 1.0, count=0)
    assert check_unlabelled(volume, labels) == ()


def test_pieces_of_fainter_grains_above_the_threshold():
    """A threshold at 0.94 of the attenuation of three grains leaves noisy pieces of them."""
    volume, labels = two_materials(1, 0.4)
    pieces = np.where((volume.array > 0.94 * 0.06) & (labels == 0) & (volume.array < 0.08), 13, labels)
    (finding,) = check_fragments(volume, pieces, 0.94 * 0.06)
    assert "1 of 10 grains hardly exceed the threshold" in finding.fact
    assert check_fragments(volume, labels, 0.94 * 0.06) == ()
    assert check_fragments(volume, pieces, float("nan")) == ()
