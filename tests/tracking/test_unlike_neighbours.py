"""Grains that rotated unlike their neighbours and fit less well (`tracking.unlike_neighbours`)."""

from dataclasses import replace

import numpy as np
import pytest

import many_small_grains as many
from grainmotion.model.motions import Motions, Status
from grainmotion.objective.data_term import Target
from grainmotion.objective.residual import StateProblem
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.rotations import rotation_matrix
from grainmotion.tracking import unlike_neighbours as module
from grainmotion.tracking.unlike_neighbours import UNLIKE_REASON, unlike_neighbours, with_unlike_neighbours
from grainmotion.uncertainty.goodness_of_fit import misfits

TURNED = 7


@pytest.fixture(scope="module")
def state():
    """A problem of 125 grains, and its true pose but for one grain, which is turned by 60 degrees."""
    grains, views = many.block(5), many.views(5)
    scan, truth = many.state(grains, views)
    problem = StateProblem(GrainArrays.of(grains), Target(scan, np.zeros(scan.line_integrals.shape), "trilinear", 0.7))
    matrices = truth.matrices.copy()
    matrices[TURNED] = rotation_matrix(np.array([[0.0, 0.0, np.deg2rad(60)]]))[0]
    return grains, problem, truth, replace(truth, matrices=matrices)


def test_a_turned_grain_that_fits_less_well_is_doubtful(state):
    _, problem, truth, pose = state
    fits = misfits(problem, problem.evaluate(pose))
    assert np.flatnonzero(unlike_neighbours(problem.grains, pose, fits)).tolist() == [TURNED]
    good = misfits(problem, problem.evaluate(truth))
    assert not unlike_neighbours(problem.grains, truth, good).any()
    assert not unlike_neighbours(problem.grains, pose, good).any()  # as good as the others: it may have rotated so far


def test_its_motion_is_no_result_to_use(state, monkeypatch):
    grains, problem, _, pose = state
    everything = np.ones(len(grains), dtype=bool)
    motions = Motions.identity(grains.labels, grains.centers)
    statuses = np.full_like(motions.statuses, Status.CONVERGED.value)
    motions = replace(motions, statuses=statuses, ok_translation=everything, ok_rotation=everything.copy())
    assert motions.ok.all()
    found = with_unlike_neighbours(motions, problem, pose, problem.evaluate(pose))
    assert np.flatnonzero(~found.ok).tolist() == [TURNED]
    assert found.statuses[TURNED] == Status.NOT_CONVERGED.value
    assert found.reasons[TURNED] == UNLIKE_REASON
    assert not found.ok_translation[TURNED]
    assert not found.ok_rotation[TURNED]
    monkeypatch.setattr(module, "MIN_GRAINS_IN_PARTS", 126)
    assert with_unlike_neighbours(motions, problem, pose, problem.evaluate(pose)) is motions
