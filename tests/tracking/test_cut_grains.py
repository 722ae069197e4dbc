"""Grains of which a view sees a part, and their status."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from few_grains import PANEL, VOXEL, geometry, grain_set, motions, radiographs
from grainmotion.model.field_of_view import FieldOfView
from grainmotion.model.motions import Status
from grainmotion.model.pose import Pose
from grainmotion.model.scene import Scene
from grainmotion.objective.data_term import Target
from grainmotion.objective.residual import StateProblem
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.tracking.cut_grains import cut_by_panel
from grainmotion.tracking.track import TrackSettings, track

QUICK = TrackSettings(search=False, fields=False, filters=(2.0, 0.7))


@pytest.fixture(scope="module")
def grains():
    return grain_set(finer=1)


def cut_on(grains, rows, shift=0.0):
    """Grains that a panel of fewer rows cuts after a shift upwards (voxels)."""
    views = geometry().window((0, 0), (rows, PANEL[1]))
    scan = replace(radiographs(grains, motions(grains)), geometry=geometry())
    scan = type(scan)(scan.line_integrals[:, :rows], views)
    arrays = GrainArrays.of(grains)
    problem = StateProblem(arrays, Target(scan, np.zeros(scan.line_integrals.shape, np.float32), "trilinear", 0.0))
    pose = Pose(np.tile([0, 0, shift * VOXEL], (len(grains), 1)), np.tile(np.eye(3), (len(grains), 1, 1)))
    return cut_by_panel(problem, pose, problem.evaluate(pose))


def test_a_panel_that_holds_all_cuts_none(grains):
    assert not cut_on(grains, PANEL[0]).any()


def test_grains_partly_off_the_panel_are_cut(grains):
    tops = np.array([g.center[2] / VOXEL for g in grains.grains])
    cut = cut_on(grains, 37)  # up to 11 voxels above the middle
    assert cut.tolist() == (np.abs(tops - 11) < 7).tolist()


def test_a_grain_beyond_the_panel_is_not_cut(grains):
    assert not cut_on(grains, PANEL[0], 60.0).any()


def test_cut_grains_are_tracked_and_never_converged(grains):
    field = FieldOfView(geometry(), 3.0, below=True)
    first = replace(grains.grains[0], touches_border=True)
    cut = replace(grains, grains=(first, *grains.grains[1:]), scene=Scene(field=field))
    truth = motions(grains, translations=np.tile([0.05, -0.03, 0.04], (len(grains), 1)))
    measured = track(cut, radiographs(grains, truth), settings=QUICK)
    assert measured.statuses.tolist() == [Status.CUT.value, *[Status.CONVERGED.value] * 4]
    assert "border of the reference" in measured.reasons[0]
    np.testing.assert_allclose(measured.translations, truth.translations, atol=0.02)
    known = track(replace(cut, scene=Scene()), radiographs(grains, truth), settings=QUICK)
    assert known.ok.all()
