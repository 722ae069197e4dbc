"""Scans of a panel that is out of place, by the library's default chain without `calibrate`: no motion is a lie."""

from __future__ import annotations

import numpy as np
import pytest
from validation.accuracy.laboratory_scores import reference_grains

from grainmotion.analysis.validation import compare
from grainmotion.simulate import LATER_ANGLES_DEG, hard_case
from grainmotion.tracking.track import track


@pytest.fixture(scope="module")
def sample():
    case = hard_case("misaligned", 0)
    return case, reference_grains(case.reference(), case.case.scanner.grid)


@pytest.mark.parametrize("views", [4, 2])
def test_errors_of_the_whole_sample_are_in_the_standard_deviations(sample, views):
    case, grains = sample
    measured = track(grains, case.state(LATER_ANGLES_DEG[views]))
    found = compare(measured, case.motions, case.case.scanner.voxel_size)
    errors = np.hstack([found.translation_errors, np.deg2rad(found.rotation_errors_deg)])
    sd = np.sqrt(np.diagonal(measured.covariances, axis1=1, axis2=2))[found.matches]
    assert np.abs(errors[:, :2]).max() > 0.5 * case.case.scanner.voxel_size
    assert (np.abs(errors) < 5 * sd).all()
    assert np.mean(np.abs(errors) < 1.96 * sd) > 0.85
    assert any("panel were out of place" in note for note in measured.fit.notes)
    assert not measured.ok_translation.any()
