"""Simulated annealing (`tracking.simulated_annealing`): grains far from the start, tables, seeds, rounding."""

from dataclasses import replace

import numpy as np
from validation.paper import images

from few_grains import VOXEL, errors, grain_set, motions, radiographs
from grainmotion.model.geometry import Geometry
from grainmotion.model.pose import Pose
from grainmotion.model.scan import Scan
from grainmotion.objective.data_term import Target
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.projection.grains import simulate_radiographs
from grainmotion.rotations import rotation_matrix, rotation_vector
from grainmotion.tracking import simulated_annealing as module
from grainmotion.tracking.global_search import PLANAR_ATTEMPTS
from grainmotion.tracking.simulated_annealing import SearchRanges, anneal

PACKED = GrainArrays.of(grain_set(finer=1))
RANGES = SearchRanges(
    max_rotation=np.deg2rad(60), max_shift=0.5, grain_pixels=10.0, shift_step=1.0, rotation_step=1.2, sweeps=15
)


def moved(rows, shift, rotation_deg, seed=0):
    """The grains of ``rows`` shifted (mm) and rotated in random directions; the others at rest."""
    rng = np.random.default_rng(seed)
    u, w = np.zeros((2, len(grain_set()), 3))
    for vectors, size in ((u, shift), (w, rotation_deg)):
        directions = rng.normal(size=(len(rows), 3))
        vectors[rows] = size * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    return motions(grain_set(), u, w)


def start():
    return Pose(np.zeros((len(grain_set()), 3)), np.tile(np.eye(3), (len(grain_set()), 1, 1)))


def target(truth):
    scan = radiographs(grain_set(), truth)
    return Target(scan, np.zeros(scan.line_integrals.shape, np.float32), "trilinear", sigma=0.0)


class TestAnneal:
    def test_grains_far_from_the_start(self):
        """Two of five, shifted by half a diameter and rotated by 50°, end close enough for Gauss–Newton."""
        rows = np.array([1, 3])
        truth = moved(rows, 0.5 * 14 * VOXEL, 50.0)
        annealed = anneal(PACKED, target(truth), start(), rows, RANGES, seed=1)
        distances = np.linalg.norm(annealed.translations - truth.translations, axis=1) / VOXEL
        angles = np.rad2deg(
            np.linalg.norm(rotation_vector(annealed.matrices @ np.swapaxes(truth.matrices, 1, 2)), axis=1)
        )
        assert distances[rows].max() < 2.5
        assert angles[rows].max() < 25
        fixed = np.setdiff1d(np.arange(len(grain_set())), rows)
        np.testing.assert_array_equal(annealed.translations[fixed], 0)
        np.testing.assert_array_equal(annealed.matrices[fixed], np.tile(np.eye(3), (len(fixed), 1, 1)))

    def test_many_grains_get_fewer_candidate_rotations(self, monkeypatch):
        """The table of patches is limited: with a quarter of its size there are fewer rotations and the identity."""
        tables = []
        make_table = module._CandidateTable.of.__func__

        def recorded(cls, *arguments):
            tables.append(make_table(cls, *arguments))
            return tables[-1]

        monkeypatch.setattr(module._CandidateTable, "of", classmethod(recorded))
        truth = moved(np.array([1]), 0.2, 20.0)
        anneal(PACKED, target(truth), start(), np.arange(5), RANGES, seed=0)
        monkeypatch.setattr(module, "MAX_TABLE_NUMBERS", tables[0].values.size // 4)
        anneal(PACKED, target(truth), start(), np.arange(5), RANGES, seed=0)
        assert tables[1].values.size <= module.MAX_TABLE_NUMBERS + tables[0].values.shape[1]
        assert any(np.allclose(rotation, np.eye(3)) for rotation in tables[1].rotations)

    def test_the_same_seed_gives_the_same_poses(self):
        truth = moved(np.array([2]), 0.5, 40.0)
        poses = [anneal(PACKED, target(truth), start(), np.array([2]), RANGES, seed=s) for s in (5, 5)]
        np.testing.assert_array_equal(poses[0].translations, poses[1].translations)
        np.testing.assert_array_equal(poses[0].matrices, poses[1].matrices)

    def test_registered_grains_do_not_move(self):
        truth = moved(np.array([0]), 0.0, 0.0)
        annealed = anneal(PACKED, target(truth), start(), np.arange(5), RANGES, seed=0)
        u, w = errors(
            motions(grain_set(), annealed.translations, np.rad2deg(rotation_vector(annealed.matrices))), truth
        )
        assert np.abs(u).max() < 1.5
        assert np.abs(w).max() < 12

    def test_rounding_has_no_effect(self):
        """Radiographs and starts that differ in their last digits give the same draws: energies are integers."""
        rng = np.random.default_rng(6)
        truth = moved(np.array([1, 3]), 0.5, 40.0)
        scan, begin = target(truth).scan, start()
        poses = []
        for change in (0.0, 1e-13, -1e-13):
            last_digit = np.float32(6e-8) * rng.integers(-1, 2, scan.line_integrals.shape) * (change != 0)
            other = (scan.line_integrals * (1 + last_digit)).astype(np.float32)
            assert (other != scan.line_integrals).any() == (change != 0)
            again = replace(target(truth), scan=replace(scan, line_integrals=other))
            near = Pose(begin.translations + change, rotation_matrix(np.full((len(grain_set()), 3), change)))
            poses.append(anneal(PACKED, again, near, np.arange(5), RANGES, seed=2))
        for pose in poses[1:]:
            np.testing.assert_array_equal(pose.translations, poses[0].translations)
            np.testing.assert_array_equal(pose.matrices, poses[0].matrices)

    def test_ties_of_half_a_pixel_are_rounded_alike(self, monkeypatch):
        """With views at 0° and 90° shifts by half a pixel are ties, which rounding of derivatives must not decide."""
        grains = images.draw(3).grains("dense")
        views = Geometry.parallel((0.0, 90.0), images.PANEL, 1.0)
        scan = Scan(simulate_radiographs(grains, images.large_motions(grains, 3), views), views)
        data_term = Target(scan, np.zeros(scan.line_integrals.shape), "trilinear", sigma=0.0)
        still = Pose(np.zeros((6, 3)), np.tile(np.eye(3), (6, 1, 1)))
        derivatives, rng, poses = module._pixel_derivatives, np.random.default_rng(0), []
        for size in (0.0, 1e-14, 1e-14):
            monkeypatch.setattr(
                module, "_pixel_derivatives", lambda *a, s=size: derivatives(*a) + s * rng.normal(size=(6, 2, 2, 3))
            )
            poses.append(anneal(GrainArrays.of(grains), data_term, still, np.arange(6), PLANAR_ATTEMPTS[0], seed=1))
        for pose in poses[1:]:
            np.testing.assert_array_equal(pose.translations, poses[0].translations)
            np.testing.assert_array_equal(pose.matrices, poses[0].matrices)
