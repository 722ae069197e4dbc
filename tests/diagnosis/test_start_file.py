"""Motions from a file, held against the grains from which a state starts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from convex_grains import VOXEL, ConvexGrains
from grainmotion.diagnosis.start_file import check_start
from grainmotion.model.finding import Level
from grainmotion.model.motions import Motions
from grainmotion.segmentation.extraction import grains_from_labels


@pytest.fixture(scope="module")
def sample():
    """Grid and grains."""
    volume, labels = ConvexGrains.random(4, 9).voxels()
    return volume, grains_from_labels(volume, labels, finer=1)


@pytest.fixture
def start(sample):
    _, grains = sample
    labels = np.array([g.label for g in grains.grains])
    noise = np.random.default_rng(0).normal(0, 0.02, (len(labels), 3))
    return Motions.identity(labels, grains.centers + noise * VOXEL)


def facts(sample, start):
    volume, grains = sample
    return " | ".join(f.fact for f in check_start(start, grains, volume))


def test_motions_of_these_grains(sample, start):
    assert facts(sample, start) == ""


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda c, v: c[:, ::-1], "z y x of axes"),
        (lambda c, v: (c - v.origin) / VOXEL, "in voxels, not in mm"),
        (lambda c, v: ((c - v.origin) / VOXEL)[:, ::-1], "in voxels, z y x"),
        (lambda c, v: c * [1, 1, -1], "mirrored along z"),
        (lambda c, v: v.origin + 2 * (c - v.origin), "2 times as far from the corner"),
        (lambda c, v: 1000 * c, "1000 times as far from the rotation axis"),
        (lambda c, v: c + np.array([0.5, 0, -0.5]), "shifted by (4.0, -0.0, -4.0) voxels"),
    ],
)
def test_centres_of_another_frame_or_unit(sample, start, change, words):
    findings = check_start(replace(start, centers=change(start.centers, sample[0])), sample[1], sample[0])
    assert findings[0].level is Level.ERROR
    assert words.replace("-0.0", "0.0") in findings[0].fact.replace("-0.0", "0.0")


def test_another_numbering(sample, start):
    assert "number the grains otherwise" in facts(sample, replace(start, centers=np.roll(start.centers, 1, axis=0)))


def test_another_reference(sample, start):
    other = np.random.default_rng(5).uniform(-2, 2, start.centers.shape)
    assert "another reference" in facts(sample, replace(start, centers=other))


def test_translations_in_other_units(sample, start):
    far = replace(start, translations=np.full(start.centers.shape, 100.0))
    assert "more than the extent" in facts(sample, far)
