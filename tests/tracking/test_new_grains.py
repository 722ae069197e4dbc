"""A grain that appeared: it is found, named, and kept from shaking the others; strangers are named."""

from dataclasses import replace

import numpy as np
import pytest

from few_grains import GAIN_AND_OFFSET, grain_set, motions, radiographs, small_motions
from grainmotion.model.motions import Motions, StateFit, Status
from grainmotion.model.pose import Pose
from grainmotion.model.scan import Scan
from grainmotion.objective.data_term import Target
from grainmotion.objective.residual import StateProblem
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.tracking.new_grains import may_have_appeared, start_with_stand_in, unexplained_places, with_stand_in
from grainmotion.tracking.track import track

GRAINS = grain_set()
TRUTH = small_motions(GRAINS)
NEW = 2


@pytest.fixture(scope="module")
def known():
    return GRAINS.without([NEW])


def test_a_place_that_all_views_hold(known):
    scan = radiographs(GRAINS, TRUTH)
    target = Target(scan, np.zeros_like(scan.line_integrals), "trilinear", 2.0, GAIN_AND_OFFSET)
    rows = [k for k in range(len(GRAINS)) if k != NEW]
    pose = Pose(TRUTH.translations[rows], TRUTH.matrices[rows])
    problem = StateProblem(GrainArrays.of(known), target)
    (found, *_) = unexplained_places(problem, pose, problem.evaluate_with_derivatives(pose))
    radius = float(np.median(problem.grains.radii))
    assert np.linalg.norm(np.array(found[:3]) - GRAINS.centers[NEW] - TRUTH.translations[NEW]) < 0.7 * radius
    assert found[3] > 0.5


def test_nothing_strange_where_all_are_known():
    scan = radiographs(GRAINS, TRUTH)
    target = Target(scan, np.zeros_like(scan.line_integrals), "trilinear", 2.0, GAIN_AND_OFFSET)
    problem = StateProblem(GrainArrays.of(GRAINS), target)
    pose = Pose(TRUTH.translations, TRUTH.matrices)
    assert unexplained_places(problem, pose, problem.evaluate_with_derivatives(pose)) == []


def test_one_of_five_appears(known):
    measured = track(known, radiographs(GRAINS, TRUTH))
    expected = GRAINS.centers[NEW] + TRUTH.translations[NEW]
    notes = [n for n in measured.fit.notes if "appeared" in n]
    assert notes
    spot = [
        float(part.split("=")[1].split(",")[0].split(":")[0]) for part in notes[0].split(" near ")[1].split(", ")[:3]
    ]
    assert np.linalg.norm(np.array(spot) - expected) < 0.3
    rows = [k for k in range(len(GRAINS)) if k != NEW]
    errors = np.linalg.norm(measured.translations - TRUTH.translations[rows], axis=1)
    assert (errors[measured.ok] < 0.3 * GRAINS.voxel_size).all()


def test_the_stand_in_is_of_the_usual_size(known):
    place = np.array([0.1, -0.2, 0.3])
    whole = with_stand_in(known, place)
    ball = whole.grains[-1]
    assert len(whole) == len(known) + 1
    assert ball.label == known.labels.max() + 1
    masses = [g.volume.array.sum() for g in known.grains]
    assert ball.volume.array.sum() == pytest.approx(np.median(masses), rel=0.1)
    assert ball.fine is not None
    scale = (ball.volume.voxel_size / ball.fine.voxel_size) ** 3
    assert ball.fine.array.sum() == pytest.approx(scale * ball.volume.array.sum(), rel=0.05)
    start = start_with_stand_in(motions(known), whole)
    np.testing.assert_array_equal(start.labels, whole.labels)
    assert not start.translations[-1].any()
    assert start_with_stand_in(None, whole) is None


@pytest.mark.parametrize(("gain", "lost", "expected"), [(1.3, 3, True), (1.0, 3, False), (1.3, 0, False)])
def test_when_one_is_supposed(gain, lost, expected):
    some = Motions.identity(np.arange(1, 5), np.zeros((4, 3)))
    statuses = np.array([Status.NOT_CONVERGED.value] * lost + [Status.CONVERGED.value] * (4 - lost))
    assert may_have_appeared(replace(some, statuses=statuses, fit=StateFit(gain))) is expected


def test_empty_radiographs_hold_nothing_strange(known):
    scan = radiographs(GRAINS, TRUTH)
    empty = Scan(np.zeros_like(scan.line_integrals), scan.geometry)
    problem = StateProblem(GrainArrays.of(known), Target(empty, np.zeros_like(scan.line_integrals), "trilinear", 2.0))
    pose = Pose(np.zeros((4, 3)), np.tile(np.eye(3), (4, 1, 1)))
    assert unexplained_places(problem, pose, problem.evaluate_with_derivatives(pose)) == []
