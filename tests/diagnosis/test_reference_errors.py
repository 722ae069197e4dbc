"""What a reference scan shows of its own errors comes with its volume, and is in a state's notes and covariances."""

from __future__ import annotations

from dataclasses import asdict, replace

import numpy as np
import pytest

import few_grains
import grainmotion as gm
from classified_poses import classified, pose_of
from convex_grains import DISTANCES, PANEL, SHAPE, VOXEL, ConvexGrains
from grainmotion.diagnosis.moving_sample import displaced_volume, steady_motion
from grainmotion.diagnosis.panel_offset import PanelOffset
from grainmotion.diagnosis.reference_errors import ReferenceErrors
from grainmotion.model.field_of_view import FieldOfView
from grainmotion.model.motions import Status
from grainmotion.model.view_shifts import ViewShifts
from grainmotion.reconstruction.view_shifts import measured_shifts
from grainmotion.simulate import Misalignment
from grainmotion.simulate.misalignment import misaligned

ANGLES_DEG = np.arange(36) * 10.0
NOMINAL = gm.Geometry.cone(ANGLES_DEG, PANEL, 0.5, **DISTANCES)
TWO_VIEWS = gm.Geometry.cone((22.5, 112.5), PANEL, 0.5, **DISTANCES)
GRAINS = ConvexGrains.random(1, 10)


def field_of(scan: gm.Scan) -> FieldOfView:
    shifts = measured_shifts(scan, gm.Volume.zeros(SHAPE, VOXEL))
    return FieldOfView(scan.geometry, 20 * VOXEL, shifts=shifts)


def recorded(misalignment: Misalignment) -> gm.Scan:
    """A full scan in a misaligned geometry, that is told as the nominal one."""
    true = misaligned(NOMINAL, **asdict(misalignment))
    return replace(GRAINS.scan(seed=2, geometry=true), geometry=NOMINAL)


@pytest.fixture(scope="module")
def off() -> FieldOfView:
    return field_of(recorded(Misalignment((0.5, 0.5), turn_deg=0.5)))


def crept() -> FieldOfView:
    """A sample that sinks by a voxel."""
    steps = VOXEL * np.linspace(0, -1, len(ANGLES_DEG))[:, None] * [0, 0, 1]
    moved = (replace(GRAINS, centers=GRAINS.centers + step) for step in steps)
    views = [sample.scan((a,), seed=k) for k, (sample, a) in enumerate(zip(moved, ANGLES_DEG, strict=True))]
    return field_of(gm.Scan(np.concatenate([view.line_integrals for view in views]), NOMINAL))


def test_a_sound_reference_adds_nothing():
    found = ReferenceErrors.of(field_of(recorded(Misalignment())), TWO_VIEWS, GRAINS.centers)
    assert found.notes == ()
    assert not found.covariances.any()


def test_an_unknown_reference_adds_nothing():
    assert not ReferenceErrors.of(None, TWO_VIEWS, GRAINS.centers).covariances.any()


def test_a_panel_out_of_place_is_measured(off):
    panel = PanelOffset.of(off)
    assert abs(panel.shift) == pytest.approx(0.5, rel=0.3)
    assert abs(np.rad2deg(panel.turn)) == pytest.approx(0.5, rel=0.4)
    assert "calibrate" in panel.note


def test_motions_by_a_panel_are_those_that_its_views_imitate(off):
    """The grains' projections in a state on the same panel, seen from two sides, agree with these motions."""
    panel = PanelOffset(0.5, 0.0)
    motions = panel.motions(TWO_VIEWS, GRAINS.centers)
    before, after = (TWO_VIEWS.project_points(x) for x in (GRAINS.centers, GRAINS.centers + motions[:, :3]))
    np.testing.assert_allclose((after - before)[..., 1], 0.5, atol=0.05)
    np.testing.assert_allclose((after - before)[..., 0], 0.0, atol=0.05)
    found = ReferenceErrors.of(off, TWO_VIEWS, GRAINS.centers)
    shift = np.sqrt(np.trace(found.covariances[0, :3, :3])) / VOXEL
    assert shift == pytest.approx(0.5 * np.sqrt(2), rel=0.35)


def test_a_turned_panel_turns_the_grains(off):
    turned = PanelOffset(0.0, np.deg2rad(0.5)).motions(TWO_VIEWS, np.zeros((1, 3)))
    assert np.rad2deg(np.linalg.norm(turned[0, 3:])) == pytest.approx(0.5 * np.sqrt(2), rel=0.01)
    assert abs(turned[0, :3]).max() < 0.05 * VOXEL


def test_a_sample_that_crept_is_in_the_notes_with_its_size():
    found = ReferenceErrors.of(crept(), TWO_VIEWS, GRAINS.centers)
    (note,) = found.notes
    assert note.startswith("reference: the sample did not stay in its place")
    assert "crept" in note
    assert 0.01 < np.sqrt(found.covariances[0, 2, 2]) / VOXEL < 0.04


def test_a_creep_across_displaces_the_volume():
    """Of motions along x the views of one turn ask for another place along y, by the mean of t sin 2θ."""
    angles = np.deg2rad(ANGLES_DEG)
    along, times = np.stack([-np.sin(angles), np.cos(angles)], axis=1), np.arange(36) / 35 - 0.5
    seen = times * along[:, 0]
    shifts = ViewShifts(np.stack([seen, 0 * seen], axis=1), 0 * seen, np.arange(36), times, along, VOXEL, 40.0)
    place = displaced_volume(shifts, steady_motion(shifts))
    assert abs(place[1]) == pytest.approx(1 / (4 * np.pi), rel=0.1)
    field = FieldOfView(NOMINAL, 20 * VOXEL, shifts=shifts)
    sd = np.sqrt(np.diagonal(ReferenceErrors.of(field, TWO_VIEWS, GRAINS.centers).covariances[0])) / VOXEL
    assert sd[1] > 0.07
    assert sd[2] == pytest.approx(0.02, rel=0.1)


def test_statuses_and_standard_deviations_of_a_state_hold_it(off):
    """Covariances grow, and beyond the largest sd to accept the status says why."""
    grains = few_grains.grain_set(3)
    still = few_grains.motions(grains)
    scan = few_grains.radiographs(grains, still)
    before = classified(scan, pose_of(still), grains)
    after = classified(scan, pose_of(still), replace(grains, scene=replace(grains.scene, field=off)))
    assert set(before.statuses) == {Status.CONVERGED}
    assert (np.trace(after.covariances, axis1=1, axis2=2) > 100 * np.trace(before.covariances, axis1=1, axis2=2)).all()
    assert any("out of place" in note for note in after.fit.notes)
    assert set(after.statuses) == {Status.POORLY_DETERMINED}
    assert all("reference scan contradicts itself" in reason for reason in after.reasons)
