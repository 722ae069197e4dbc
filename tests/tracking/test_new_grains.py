"""New grains (`tracking.new_grains`): counted, placed, and no disturbance of the others."""

from unittest import mock

import numpy as np
import pytest

from few_grains import grain_set, radiographs, small_motions
from grainmotion.model.geometry import Geometry
from grainmotion.tracking.ellipsoids import Ellipsoid, Usual, ellipsoid_images
from grainmotion.tracking.leftover import MIN_LIMIT, Leftover
from grainmotion.tracking.track import track
from grainmotion.tracking.unexplained import grid_around

TRUTH = small_motions(grain_set(finer=1))
NEW_GRAIN = 2
GEOMETRY = Geometry.cone((0.0, 50.0, 110.0), (60, 60), 0.25, source_to_axis=60.0, source_to_detector=120.0)
USUAL = Usual(0.8, 0.1)


def ellipsoids_in(centers, axes=(0.9, 0.8, 0.7)):
    """What is found in radiographs that hold ellipsoids at ``centers`` alone."""
    there = [Ellipsoid(np.array(center), np.diag(axes), 0.1, np.full((10, 10), np.nan)) for center in centers]
    images = ellipsoid_images(there, GEOMETRY)
    left = Leftover(images, GEOMETRY, np.ones_like(images), USUAL)
    return left.ellipsoids(grid_around(np.array([[-2.0, -2, -2], [2.0, 2, 2]]), USUAL.radius))


@pytest.mark.parametrize(
    "centers",
    [
        [],
        [(0.3, -0.4, 0.5)],
        [(0.3, -0.4, 0.5), (-1.5, 0.2, -1.2), (1.4, 1.3, 0.1)],
        [(0.3, -0.4, 0.5), (1.2, 0.9, 0.7)],  # two that touch
    ],
)
def test_ellipsoids_are_counted(centers):
    found = ellipsoids_in(centers)
    assert len(found) == len(centers)
    for center in centers:
        assert min(np.linalg.norm(each.center - center) for each in found) < 0.3 * USUAL.radius


def test_small_things_are_no_grains():
    assert ellipsoids_in([(0.3, -0.4, 0.5)], (0.25, 0.25, 0.25)) == []


def test_evenly_grey_radiographs_hold_no_grains():
    """They could be filled with ever more; of a sample of two grains it is no more that is looked for."""
    grey = np.full((3, 60, 60), 0.3)
    left = Leftover(grey, GEOMETRY, np.ones_like(grey), USUAL, grains=2)
    grid = grid_around(np.array([[-2.0, -2, -2], [2.0, 2, 2]]), USUAL.radius)
    with mock.patch.object(Leftover, "fitted", autospec=True, side_effect=Leftover.fitted) as fitted:
        assert left.ellipsoids(grid) == []
    assert 1 < fitted.call_count <= MIN_LIMIT + 2


def test_a_new_grain_is_counted_and_disturbs_no_other():
    known = grain_set().without([NEW_GRAIN])
    measured = track(known, radiographs(grain_set(), TRUTH))
    (new,) = measured.fit.appeared
    place = grain_set().centers[NEW_GRAIN] + TRUTH.translations[NEW_GRAIN]
    assert np.linalg.norm(new.center - place) < 0.15
    rows = [k for k in range(len(grain_set())) if k != NEW_GRAIN]
    errors = np.linalg.norm(measured.translations - TRUTH.translations[rows], axis=1)
    assert measured.ok.all(), measured.reasons
    assert (errors < 0.3 * grain_set().voxel_size).all()


def test_nothing_appears_where_all_grains_are_known():
    assert track(grain_set(), radiographs(grain_set(), TRUTH)).fit.appeared == ()
