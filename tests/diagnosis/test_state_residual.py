"""More left over in a state than in its reference, though all grains converged, is told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

from convex_grains import ConvexGrains
from grainmotion.diagnosis.results import check_motions
from grainmotion.diagnosis.state_residual import residual_notes
from grainmotion.model.finding import Level
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.scan import Scan
from grainmotion.projection.grains import simulate_radiographs
from grainmotion.segmentation.extraction import grains_from_labels
from grainmotion.tracking.track import track

OF_REFERENCE = 0.045


@pytest.fixture(scope="module")
def sample() -> tuple[GrainSet, Scan]:
    """Convex grains and their radiographs."""
    convex = ConvexGrains.random(7, 5)
    return grains_from_labels(*convex.voxels()), convex.scan((0.0, 45.0, 90.0, 135.0), photons=2e5)


def with_residual(motions: Motions, residual: float) -> Motions:
    return replace(motions, fit=replace(motions.fit, costs=(("free", residual),)))


def test_a_rolled_camera_is_told(sample):
    """By 3 degrees, which motions take up in part: all grains converge."""
    grains, scan = sample
    rolled = replace(scan, line_integrals=ndimage.rotate(scan.line_integrals, 3.0, (1, 2), reshape=False, order=1))
    right, wrong = track(grains, scan), track(grains, rolled)
    assert wrong.usable.all()
    assert residual_notes(grains, right, scan, OF_REFERENCE) == ()
    (note,) = residual_notes(grains, wrong, rolled, OF_REFERENCE)
    findings = check_motions("a", replace(wrong, fit=replace(wrong.fit, notes=(note,))))
    assert [f.level for f in findings if f.check == "fit"] == [Level.WARNING]


def test_noise_of_short_exposures_is_not_counted(sample):
    grains, scan = sample
    still = Motions.identity([g.label for g in grains.grains], grains.centers)
    images = simulate_radiographs(grains, still, scan.geometry)
    noise = 0.2 * np.sqrt(np.mean(images**2)) * np.random.default_rng(0).normal(size=images.shape)
    noisy = replace(scan, line_integrals=(images + noise).astype(np.float32))
    assert residual_notes(grains, with_residual(still, 0.08), noisy, OF_REFERENCE) == ()


def test_a_grain_that_fails_explains_it(sample):
    grains, scan = sample
    still = Motions.identity([g.label for g in grains.grains], grains.centers)
    statuses = np.array(["not-converged", *["converged"] * (len(grains) - 1)])
    assert residual_notes(grains, with_residual(replace(still, statuses=statuses), 0.08), scan, OF_REFERENCE) == ()
