"""Void ratios of packings of spheres that are known, moved packings, cells that the border cuts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.mechanics.radical_cells import cell_variances, radical_cells
from grainmotion.mechanics.void_ratio import void_ratio
from grainmotion.model.scene import Body, Scene
from grainmotion.model.state_fit import BodyMotion
from grainmotion.model.volume import Volume
from grainmotion.rotations import rotation_matrix
from grainmotion.segmentation.extraction import grains_from_labels
from spheres import known_motions, sphere_grains, voxelised

RADIUS = 6.0
CUBIC = 2 * RADIUS * np.stack(np.meshgrid(*[[-1.0, 0, 1]] * 3), axis=-1).reshape(-1, 3)
FIELD = Volume.zeros((52, 52, 52), 1.0)
MIDDLE = int(np.flatnonzero((CUBIC == 0).all(axis=1))[0])


@pytest.fixture(scope="module")
def cubic():
    return sphere_grains(CUBIC, np.full(27, RADIUS), FIELD.shape, finer=1)


@pytest.mark.parametrize("cells", ["set", "radical"])
class TestPackings:
    def test_simple_cubic(self, cubic, cells):
        """e = 6/π − 1 = 0.910; the cells of all grains but the middle one are open."""
        found = void_ratio(cubic, FIELD, cells=cells)
        np.testing.assert_array_equal(np.flatnonzero(found.inside), [MIDDLE])
        assert found.void_ratios[MIDDLE] == pytest.approx(6 / np.pi - 1, abs=0.02)
        assert found.mean == pytest.approx(6 / np.pi - 1, abs=0.02)
        assert np.isnan(np.delete(found.void_ratios, MIDDLE)).all()

    def test_face_centred_cubic(self, cells):
        """e = √18/π − 1 = 0.350 of the middle one."""
        edge = 2 * np.sqrt(2) * RADIUS
        steps = np.stack(np.meshgrid(*[np.arange(-2.0, 3)] * 3), axis=-1).reshape(-1, 3) / 2
        centers = steps[(np.round(2 * steps).sum(axis=1) % 2 == 0)] * edge
        grains = sphere_grains(centers, np.full(len(centers), RADIUS), (52, 52, 52), finer=1)
        found = void_ratio(grains, FIELD, cells=cells)
        middle = int(np.argmin(np.linalg.norm(grains.centers, axis=1)))
        assert found.inside[middle]
        assert found.void_ratios[middle] == pytest.approx(np.sqrt(18) / np.pi - 1, abs=0.02)

    def test_a_packing_that_dilates_uniformly(self, cubic, cells):
        """Centres move apart by 5 %: 1 + e grows by 1.05³."""
        before = void_ratio(cubic, FIELD, cells=cells).void_ratios[MIDDLE]
        after = void_ratio(cubic, FIELD, known_motions(cubic.centers, 0.05 * cubic.centers), cells=cells)
        assert (1 + after.void_ratios[MIDDLE]) / (1 + before) == pytest.approx(1.05**3, rel=0.015)

    def test_a_rigid_motion_changes_nothing(self, cubic, cells):
        w = np.deg2rad([4.0, -3, 6])
        shift = cubic.centers @ (rotation_matrix(w) - np.eye(3)).T + [0.4, 0.3, -0.6]
        before = void_ratio(cubic, FIELD, cells=cells).void_ratios[MIDDLE]
        after = void_ratio(cubic, FIELD, known_motions(cubic.centers, shift, np.tile(w, (27, 1))), cells=cells)
        assert after.void_ratios[MIDDLE] == pytest.approx(before, abs=0.02)

    def test_grains_without_a_place_have_no_cell(self, cubic, cells):
        statuses = ["converged"] * 27
        statuses[3] = "absent"
        motions = known_motions(cubic.centers, np.zeros((27, 3)), statuses=statuses)
        found = void_ratio(cubic, FIELD, motions, cells=cells)
        assert 4 not in found.labels
        nothing = void_ratio(cubic, FIELD, replace(motions, statuses=np.full(27, "absent")), cells=cells)
        assert len(nothing.to_dataframe()) == 0
        assert np.isnan(nothing.mean)


def test_radical_planes_of_unequal_spheres():
    """The plane between two balls is where the power distances agree: d/2 + (r₁² − r₂²)/(2 d) from the first."""
    small, large, apart = 4.0, 8.0, 13.0
    centers = np.array([[-apart / 2, 0, 0], [apart / 2, 0, 0]])
    grains = sphere_grains(centers, [small, large], (24, 24, 40), finer=1)
    found = void_ratio(grains, Volume.zeros((24, 24, 40), 1.0), cells="radical")
    radii = np.cbrt(0.75 / np.pi * found.grain_volumes)
    plane = -apart / 2 + apart / 2 + (radii[0] ** 2 - radii[1] ** 2) / (2 * apart)
    assert found.cell_volumes[0] == pytest.approx((plane + 20) * 24 * 24, rel=1e-3)
    assert found.cell_volumes.sum() == pytest.approx(24 * 24 * 40)
    assert not found.inside.any()


def test_wrong_input_is_named(cubic):
    with pytest.raises(InputError, match="'voronoi' is unknown"):
        void_ratio(cubic, FIELD, cells="voronoi")
    with pytest.raises(InputError, match=r"labels \[28\] are not among the grains"):
        void_ratio(cubic, FIELD, known_motions(np.zeros((28, 3)), np.zeros((28, 3))))


def test_a_body_is_no_void_where_it_is_in_the_state(cubic):
    """A cube of 3 voxels in a pore of the middle grain; in the state it is somewhere else."""
    place = (RADIUS, RADIUS, RADIUS)  # between eight grains
    body = Body("insert", "body", Volume(np.ones((3, 3, 3)), 1.0, (place[0] - 0.5, place[1] - 0.5, place[2] - 0.5)))
    grains = replace(cubic, scene=Scene((body,)))
    free = void_ratio(cubic, FIELD).cell_volumes[MIDDLE]
    inner_corner = 8  # voxels of the cube that are in the cell of the middle grain; the others are on its faces
    assert free - void_ratio(grains, FIELD).cell_volumes[MIDDLE] == pytest.approx(inner_corner, abs=2)
    away = BodyMotion(
        "insert",
        "body",
        "free",
        np.array(body.center),
        np.array([-2 * RADIUS, 0, 0]),
        np.zeros(3),
        np.zeros((6, 6)),
        True,
    )
    still = known_motions(grains.centers, np.zeros((27, 3)))
    moved = replace(still, fit=replace(still.fit, bodies=(away,)))
    assert void_ratio(grains, FIELD, still).cell_volumes[MIDDLE] < free
    right, left = (
        void_ratio(grains, FIELD, m).cell_volumes - void_ratio(cubic, FIELD).cell_volumes for m in (still, moved)
    )
    beside = int(np.argmin(np.linalg.norm(cubic.centers - [2 * RADIUS, 0, 0], axis=1)))
    assert right[beside] < 0
    assert left[beside] == pytest.approx(0)


def test_a_slice_of_squares_of_discs():
    """Discs of radius r on a square lattice of 2 r: e = 4/π − 1, in the plane."""
    places = 12.0 * np.stack(np.meshgrid([-1.0, 0, 1], [-1.0, 0, 1]), axis=-1).reshape(-1, 2)
    centers = np.column_stack([places, np.zeros(9)])
    array, labels = voxelised(centers, np.full(9, 6.0), (1, 52, 52))
    grains = grains_from_labels(Volume(array, 1.0), labels)
    found = void_ratio(grains, Volume.zeros((1, 52, 52), 1.0))
    np.testing.assert_array_equal(np.flatnonzero(found.inside), [4])
    assert found.void_ratios[4] == pytest.approx(4 / np.pi - 1, abs=0.1)  # whole voxels


def test_one_grain_has_no_void_ratio():
    grains = sphere_grains([[0.0, 0, 0]], [6.0], (20, 20, 20))
    for cells in ("set", "radical"):
        found = void_ratio(grains, Volume.zeros((20, 20, 20), 1.0), cells=cells)
        assert np.isnan(found.void_ratios).all()
        assert np.isnan(found.mean)
    assert found.cell_volumes[0] == pytest.approx(20**3)


class TestUncertainty:
    """Standard deviations of void ratios by the translations of the grains."""

    RNG = np.random.default_rng(3)
    PLACES = 9 * np.stack(np.meshgrid(*[[-1.0, 0, 1]] * 3), axis=-1).reshape(-1, 3) + RNG.uniform(-1, 1, (27, 3))
    RADII = RNG.uniform(3.5, 4.5, 27)
    GRID = Volume.zeros((50, 50, 50), 1.0)

    def test_radical_cells_that_many_errors_change(self):
        """Draws of the centres from covariances that differ in size and direction: within the scatter of 200 draws."""
        factors = self.RNG.normal(size=(27, 3, 3)) * self.RNG.uniform(0.02, 0.06, (27, 1, 1))
        covariances = factors @ np.swapaxes(factors, 1, 2)
        _, inside = radical_cells(self.PLACES, self.RADII, self.GRID)
        predicted = np.sqrt(cell_variances(self.PLACES, self.RADII, self.GRID, covariances))[inside]
        drawn = [
            radical_cells(self.PLACES + np.einsum("nij,nj->ni", factors, self.RNG.normal(size=(27, 3))), self.RADII,
                          self.GRID)[0][inside]
            for _ in range(200)
        ]  # fmt: skip
        assert inside.any()
        np.testing.assert_allclose(np.std(drawn, axis=0, ddof=1) / predicted, 1, atol=4 / np.sqrt(2 * 200))

    def test_set_cells_that_many_errors_change(self, cubic):
        """The same faces bound them: within 20 % of the scatter of 30 draws, whose own is 13 %."""
        scatter, sd = [], 0.2
        for _ in range(30):
            motions = known_motions(cubic.centers, self.RNG.normal(0, sd, (27, 3)), sd=sd)
            scatter.append(void_ratio(cubic, FIELD, motions).cell_volumes[MIDDLE])
        found = void_ratio(cubic, FIELD, known_motions(cubic.centers, np.zeros((27, 3)), sd=sd))
        assert found.void_ratio_sds[MIDDLE] == pytest.approx(
            np.std(scatter, ddof=1) / found.grain_volumes[MIDDLE], rel=0.4
        )

    def test_none_in_the_reference_and_none_for_cut_cells(self, cubic):
        found = void_ratio(cubic, FIELD, cells="radical")
        assert found.void_ratio_sds[MIDDLE] == 0
        assert np.isnan(np.delete(found.void_ratio_sds, MIDDLE)).all()

    def test_a_neighbour_without_covariance_leaves_none(self, cubic):
        motions = known_motions(cubic.centers, np.zeros((27, 3)), sd=0.1)
        beside = int(np.argmin(np.linalg.norm(CUBIC - [2 * RADIUS, 0, 0], axis=1)))
        covariances = motions.covariances.copy()
        covariances[beside] = np.nan
        found = void_ratio(cubic, FIELD, replace(motions, covariances=covariances), cells="radical")
        assert np.isnan(found.void_ratio_sds[MIDDLE])
        assert np.isfinite(found.void_ratios[MIDDLE])
