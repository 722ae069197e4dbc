"""Annealing: misregistered grains are found from far away."""

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

GRAINS = grain_set()
PACKED = GrainArrays.of(GRAINS)
FAR = SearchRanges(
    max_rotation=np.deg2rad(60), max_shift=0.5, grain_pixels=10.0, shift_step=1.0, rotation_step=1.2, sweeps=15
)


def moved(rows, shift, turn_deg, seed=0):
    """The grains of ``rows`` carried by ``shift`` (mm) and turned, each its own way; the others at rest."""
    rng = np.random.default_rng(seed)
    u, w = np.zeros((2, len(GRAINS), 3))
    for vectors, size in ((u, shift), (w, turn_deg)):
        ways = rng.normal(size=(len(rows), 3))
        vectors[rows] = size * ways / np.linalg.norm(ways, axis=1, keepdims=True)
    return motions(GRAINS, u, w)


def start():
    return Pose(np.zeros((len(GRAINS), 3)), np.tile(np.eye(3), (len(GRAINS), 1, 1)))


def target(truth):
    scan = radiographs(GRAINS, truth)
    return Target(scan, np.zeros(scan.line_integrals.shape, np.float32), "trilinear", sigma=0.0)


class TestAnneal:
    def test_grains_far_away_and_turned_far(self):
        """Two of five, half a diameter away and turned by 50°: near enough for Gauss–Newton afterwards."""
        rows = np.array([1, 3])
        truth = moved(rows, 0.5 * 14 * VOXEL, 50.0)
        found = anneal(PACKED, target(truth), start(), rows, FAR, seed=1)
        apart = np.linalg.norm(found.translations - truth.translations, axis=1) / VOXEL
        turned = np.rad2deg(np.linalg.norm(rotation_vector(found.matrices @ np.swapaxes(truth.matrices, 1, 2)), axis=1))
        assert apart[rows].max() < 2.5
        assert turned[rows].max() < 25
        held = np.setdiff1d(np.arange(len(GRAINS)), rows)
        np.testing.assert_array_equal(found.translations[held], 0)
        np.testing.assert_array_equal(found.matrices[held], np.tile(np.eye(3), (len(held), 1, 1)))

    def test_many_grains_get_fewer_turns(self, monkeypatch):
        """The table of patches is bounded: with a tenth of the room there are fewer turns, none among them."""
        room = []
        of = module._CandidateTable.of.__func__

        def kept(cls, *arguments):
            room.append(of(cls, *arguments))
            return room[-1]

        monkeypatch.setattr(module._CandidateTable, "of", classmethod(kept))
        truth = moved(np.array([1]), 0.2, 20.0)
        anneal(PACKED, target(truth), start(), np.arange(5), FAR, seed=0)
        monkeypatch.setattr(module, "MAX_TABLE_NUMBERS", room[0].values.size // 4)
        anneal(PACKED, target(truth), start(), np.arange(5), FAR, seed=0)
        assert room[1].values.size <= module.MAX_TABLE_NUMBERS + room[0].values.shape[1]
        assert any(np.allclose(turn, np.eye(3)) for turn in room[1].rotations)

    def test_a_seed_says_it_all(self):
        truth = moved(np.array([2]), 0.5, 40.0)
        ends = [anneal(PACKED, target(truth), start(), np.array([2]), FAR, seed=s) for s in (5, 5)]
        np.testing.assert_array_equal(ends[0].translations, ends[1].translations)
        np.testing.assert_array_equal(ends[0].matrices, ends[1].matrices)

    def test_a_grain_in_its_place_stays(self):
        truth = moved(np.array([0]), 0.0, 0.0)
        found = anneal(PACKED, target(truth), start(), np.arange(5), FAR, seed=0)
        u, w = errors(motions(GRAINS, found.translations, np.rad2deg(rotation_vector(found.matrices))), truth)
        assert np.abs(u).max() < 1.5
        assert np.abs(w).max() < 12

    def test_rounding_does_not_show(self):
        """Radiographs and starts that differ in their last digits give the same draws: whole numbers are weighed."""
        rng = np.random.default_rng(6)
        truth = moved(np.array([1, 3]), 0.5, 40.0)
        scan, begin = target(truth).scan, start()
        ends = []
        for change in (0.0, 1e-13, -1e-13):
            last_digit = np.float32(6e-8) * rng.integers(-1, 2, scan.line_integrals.shape) * (change != 0)
            other = (scan.line_integrals * (1 + last_digit)).astype(np.float32)
            assert (other != scan.line_integrals).any() == (change != 0)
            again = replace(target(truth), scan=replace(scan, line_integrals=other))
            near = Pose(begin.translations + change, rotation_matrix(np.full((len(GRAINS), 3), change)))
            ends.append(anneal(PACKED, again, near, np.arange(5), FAR, seed=2))
        for end in ends[1:]:
            np.testing.assert_array_equal(end.translations, ends[0].translations)
            np.testing.assert_array_equal(end.matrices, ends[0].matrices)

    def test_half_a_pixel_is_half_a_pixel(self, monkeypatch):
        """With views at 0° and 90° shifts by half a pixel are ties, whose slopes' last digits must not decide."""
        grains = images.draw(3).grains("dense")
        views = Geometry.parallel((0.0, 90.0), images.PANEL, 1.0)
        scan = Scan(simulate_radiographs(grains, images.large_motions(grains, 3), views), views)
        seen = Target(scan, np.zeros(scan.line_integrals.shape), "trilinear", sigma=0.0)
        still = Pose(np.zeros((6, 3)), np.tile(np.eye(3), (6, 1, 1)))
        slopes, rng, ends = module._pixel_derivatives, np.random.default_rng(0), []
        for size in (0.0, 1e-14, 1e-14):
            monkeypatch.setattr(
                module, "_pixel_derivatives", lambda *a, s=size: slopes(*a) + s * rng.normal(size=(6, 2, 2, 3))
            )
            ends.append(anneal(GrainArrays.of(grains), seen, still, np.arange(6), PLANAR_ATTEMPTS[0], seed=1))
        for end in ends[1:]:
            np.testing.assert_array_equal(end.translations, ends[0].translations)
            np.testing.assert_array_equal(end.matrices, ends[0].matrices)
