"""Unexplained attenuation (`tracking.unexplained`) is located."""

import numpy as np
import pytest

from few_grains import GAIN_AND_OFFSET, grain_set, radiographs, small_motions
from grainmotion.model.pose import Pose
from grainmotion.model.scan import Scan
from grainmotion.objective.data_term import Target
from grainmotion.objective.residual import StateProblem
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.tracking.unexplained import unexplained_places

TRUTH = small_motions(grain_set(finer=1))
NEW_GRAIN = 2


@pytest.fixture(scope="module")
def known_grains():
    return grain_set().without([NEW_GRAIN])


def test_a_new_grain_is_located(known_grains):
    scan = radiographs(grain_set(), TRUTH)
    target = Target(scan, np.zeros_like(scan.line_integrals), "trilinear", 2.0, GAIN_AND_OFFSET)
    rows = [k for k in range(len(grain_set())) if k != NEW_GRAIN]
    pose = Pose(TRUTH.translations[rows], TRUTH.matrices[rows])
    problem = StateProblem(GrainArrays.of(known_grains), target)
    (place, *_) = unexplained_places(problem, pose, problem.evaluate_with_derivatives(pose))
    radius = float(np.median(problem.grains.radii))
    assert (
        np.linalg.norm(np.array(place[:3]) - grain_set().centers[NEW_GRAIN] - TRUTH.translations[NEW_GRAIN])
        < 0.7 * radius
    )
    assert place[3] > 0.5


def test_no_unexplained_attenuation_if_all_grains_are_given():
    scan = radiographs(grain_set(), TRUTH)
    target = Target(scan, np.zeros_like(scan.line_integrals), "trilinear", 2.0, GAIN_AND_OFFSET)
    problem = StateProblem(GrainArrays.of(grain_set()), target)
    pose = Pose(TRUTH.translations, TRUTH.matrices)
    assert unexplained_places(problem, pose, problem.evaluate_with_derivatives(pose)) == []


def test_no_unexplained_attenuation_on_empty_radiographs(known_grains):
    scan = radiographs(grain_set(), TRUTH)
    empty = Scan(np.zeros_like(scan.line_integrals), scan.geometry)
    problem = StateProblem(
        GrainArrays.of(known_grains), Target(empty, np.zeros_like(scan.line_integrals), "trilinear", 2.0)
    )
    pose = Pose(np.zeros((4, 3)), np.tile(np.eye(3), (4, 1, 1)))
    assert unexplained_places(problem, pose, problem.evaluate_with_derivatives(pose)) == []
