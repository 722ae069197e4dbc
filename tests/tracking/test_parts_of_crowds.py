"""Parts of large samples (`tracking.parts_of_crowds`): windows of the radiographs, less everything else."""

import numpy as np
import pytest

import many_small_grains as many
from grainmotion.model.pose import Pose
from grainmotion.projection.footprints import footprint_patches
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.projection.grains import assemble, project_patches
from grainmotion.tracking.attempt import Job
from grainmotion.tracking.parts_of_crowds import Whole
from grainmotion.tracking.settings import TrackSettings

MIDDLE = 62


@pytest.fixture(scope="module")
def part():
    """The part around a grain of 125 in their true places."""
    grains = many.block(5)
    scan, pose = many.state(grains, many.views(5), noise=0.0)
    job = Job(grains, scan, None, TrackSettings(gain="none", trend="none"), None, None)
    fit = job.fit()
    problem, _ = fit.solve_few(pose, np.array([0]), "one", 0.01)
    bad = np.arange(len(grains)) == MIDDLE
    far = Pose(pose.translations + 1.0, pose.matrices)
    return job, pose, far, Whole.at(job, problem, pose).part(MIDDLE, bad, far)


def test_it_holds_the_grain_and_those_around_it(part):
    job, _, _, found = part
    distances = np.linalg.norm(job.grains.centers - job.grains.centers[MIDDLE], axis=1)
    others = np.setdiff1d(np.arange(len(job.grains)), found.rows)
    assert MIDDLE in found.rows
    assert 7 <= len(found.rows) < 60
    assert distances[found.rows].max() < distances[others].min()
    np.testing.assert_array_equal(found.job.grains.labels, job.grains.labels[found.rows])


def test_its_views_are_windows_of_the_panels(part):
    """A point is projected to the same pixel, counted from the window's first."""
    job, _, _, found = part
    points = job.grains.centers[found.rows]
    own, whole = found.job.scan.geometry, job.scan.geometry
    assert np.prod(own.shape) < np.prod(whole.shape)
    shifted = whole.project_points(points) - found.first[:, None, :]
    np.testing.assert_allclose(own.project_points(points), shifted, atol=1e-9)


def test_its_radiographs_are_those_of_its_grains_alone(part):
    _, pose, _, found = part
    arrays, geometry = GrainArrays.of(found.job.grains), found.job.scan.geometry
    at = Pose(pose.translations[found.rows], pose.matrices[found.rows])
    patches = footprint_patches(arrays, at, geometry)
    alone = assemble(project_patches(arrays, at, geometry, patches, "trilinear"), patches, geometry)
    np.testing.assert_allclose(found.job.scan.line_integrals, alone, atol=1e-3 * alone.max())


def test_grains_that_fit_badly_start_from_the_field(part):
    _, pose, far, found = part
    start = found.job.start
    middle = found.rows == MIDDLE
    np.testing.assert_array_equal(found.bad, middle)
    np.testing.assert_allclose(start.translations[middle], far.translations[[MIDDLE]])
    np.testing.assert_allclose(start.translations[~middle], pose.translations[found.rows[~middle]])


def test_misfits_know_of_the_others_on_their_rays(part):
    found = part[-1]
    squares = found.job.other_squares
    assert squares.shape == found.job.scan.line_integrals.shape
    assert squares.min() >= 0
    assert squares.max() > 0
    assert found.job.fit().target.other_squares is squares
