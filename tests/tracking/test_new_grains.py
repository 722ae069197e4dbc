"""New grains (`tracking.new_grains`): unexplained attenuation is located and reported, and disturbs no other grain."""

from dataclasses import replace

import numpy as np
import pytest

from few_grains import GAIN_AND_OFFSET, grain_set, motions, radiographs, small_motions
from grainmotion.model.motions import Motions, Status
from grainmotion.model.pose import Pose
from grainmotion.model.scan import Scan
from grainmotion.model.state_fit import StateFit
from grainmotion.objective.data_term import Target
from grainmotion.objective.residual import StateProblem
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.tracking.new_grains import may_have_appeared, start_with_stand_in, unexplained_places, with_stand_in
from grainmotion.tracking.track import track

GRAINS = grain_set()
TRUTH = small_motions(GRAINS)
NEW_GRAIN = 2


@pytest.fixture(scope="module")
def known_grains():
    return GRAINS.without([NEW_GRAIN])


def test_a_new_grain_is_located(known_grains):
    scan = radiographs(GRAINS, TRUTH)
    target = Target(scan, np.zeros_like(scan.line_integrals), "trilinear", 2.0, GAIN_AND_OFFSET)
    rows = [k for k in range(len(GRAINS)) if k != NEW_GRAIN]
    pose = Pose(TRUTH.translations[rows], TRUTH.matrices[rows])
    problem = StateProblem(GrainArrays.of(known_grains), target)
    (place, *_) = unexplained_places(problem, pose, problem.evaluate_with_derivatives(pose))
    radius = float(np.median(problem.grains.radii))
    assert (
        np.linalg.norm(np.array(place[:3]) - GRAINS.centers[NEW_GRAIN] - TRUTH.translations[NEW_GRAIN]) < 0.7 * radius
    )
    assert place[3] > 0.5


def test_no_unexplained_attenuation_if_all_grains_are_given():
    scan = radiographs(GRAINS, TRUTH)
    target = Target(scan, np.zeros_like(scan.line_integrals), "trilinear", 2.0, GAIN_AND_OFFSET)
    problem = StateProblem(GrainArrays.of(GRAINS), target)
    pose = Pose(TRUTH.translations, TRUTH.matrices)
    assert unexplained_places(problem, pose, problem.evaluate_with_derivatives(pose)) == []


def test_a_new_grain_is_noted_and_disturbs_no_other(known_grains):
    measured = track(known_grains, radiographs(GRAINS, TRUTH))
    expected = GRAINS.centers[NEW_GRAIN] + TRUTH.translations[NEW_GRAIN]
    notes = [n for n in measured.fit.notes if "appeared" in n]
    assert notes
    noted = [
        float(part.split("=")[1].split(",")[0].split(":")[0]) for part in notes[0].split(" near ")[1].split(", ")[:3]
    ]
    assert np.linalg.norm(np.array(noted) - expected) < 0.3
    rows = [k for k in range(len(GRAINS)) if k != NEW_GRAIN]
    errors = np.linalg.norm(measured.translations - TRUTH.translations[rows], axis=1)
    assert (errors[measured.ok] < 0.3 * GRAINS.voxel_size).all()


def test_the_stand_in_has_the_median_mass(known_grains):
    place = np.array([0.1, -0.2, 0.3])
    whole = with_stand_in(known_grains, place)
    ball = whole.grains[-1]
    assert len(whole) == len(known_grains) + 1
    assert ball.label == known_grains.labels.max() + 1
    masses = [g.volume.array.sum() for g in known_grains.grains]
    assert ball.volume.array.sum() == pytest.approx(np.median(masses), rel=0.1)
    assert ball.fine is not None
    scale = (ball.volume.voxel_size / ball.fine.voxel_size) ** 3
    assert ball.fine.array.sum() == pytest.approx(scale * ball.volume.array.sum(), rel=0.05)
    start = start_with_stand_in(motions(known_grains), whole)
    np.testing.assert_array_equal(start.labels, whole.labels)
    assert not start.translations[-1].any()
    assert start_with_stand_in(None, whole) is None


@pytest.mark.parametrize(("gain", "misregistered", "expected"), [(1.3, 3, True), (1.0, 3, False), (1.3, 0, False)])
def test_a_new_grain_is_supposed_if_gain_is_high_and_grains_failed(gain, misregistered, expected):
    measured = Motions.identity(np.arange(1, 5), np.zeros((4, 3)))
    statuses = np.array([Status.NOT_CONVERGED.value] * misregistered + [Status.CONVERGED.value] * (4 - misregistered))
    assert may_have_appeared(replace(measured, statuses=statuses, fit=StateFit(gain))) is expected


def test_no_unexplained_attenuation_on_empty_radiographs(known_grains):
    scan = radiographs(GRAINS, TRUTH)
    empty = Scan(np.zeros_like(scan.line_integrals), scan.geometry)
    problem = StateProblem(
        GrainArrays.of(known_grains), Target(empty, np.zeros_like(scan.line_integrals), "trilinear", 2.0)
    )
    pose = Pose(np.zeros((4, 3)), np.tile(np.eye(3), (4, 1, 1)))
    assert unexplained_places(problem, pose, problem.evaluate_with_derivatives(pose)) == []
