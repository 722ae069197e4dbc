"""Plans (`planning`): Fisher information, predicted standard deviations, choice of views, capture ranges."""

import dataclasses
import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import few_grains
from grainmotion import simulate
from grainmotion.analysis.validation import compare
from grainmotion.errors import InputError
from grainmotion.model.geometry import Geometry
from grainmotion.model.grains import GrainSet
from grainmotion.planning import capture_range, fisher_information, view_selection
from grainmotion.planning.candidates import angles_between, candidate_angles, even_set, nearest_views
from grainmotion.planning.fisher_information import Candidates
from grainmotion.planning.plan import PLAN_COLUMNS, Plan, PlanSettings, plan
from grainmotion.planning.view_selection import ViewSelector
from grainmotion.projection.footprints import footprint_patches
from grainmotion.projection.grains import differentiate_patches, simulate_radiographs
from grainmotion.reconstruction.reconstruct import ReconstructSettings, reconstruct
from grainmotion.rotations import rotation_matrix
from grainmotion.segmentation.extraction import grains_from_labels
from grainmotion.segmentation.segment import segment
from grainmotion.solvers.block_cg import diagonal_blocks
from grainmotion.tracking.track import TrackSettings, track

STEP = 15.0
QUICK = TrackSettings(search=False, fields=False)
STATES = 5
SETTINGS = PlanSettings(step_deg=STEP, views=(2, 4), model_error=0.0)


def circle(settings: PlanSettings = SETTINGS) -> Geometry:
    return few_grains.geometry(candidate_angles("cone", settings))


@cache
def few() -> GrainSet:
    return few_grains.grain_set(4)


@cache
def planned() -> Plan:
    return plan(few(), circle(), SETTINGS)


def candidates(geometry: Geometry | None = None, **changes) -> Candidates:
    return Candidates(few(), geometry or circle(), dataclasses.replace(SETTINGS, **changes))


def sd(candidates_of_views: Candidates, views) -> np.ndarray:
    return np.sqrt(np.einsum("nkk->nk", candidates_of_views.covariances(views)))


class TestInformation:
    def test_information_is_the_weighted_product_of_the_derivatives(self):
        """Against the dense Jacobian with gain and offset as two more columns."""
        views = candidates()
        view = 3
        geometry, n = views.geometry[view], len(few())
        patches = footprint_patches(views.grain_arrays, views.pose, geometry)
        _, derivatives = differentiate_patches(views.grain_arrays, views.pose, geometry, patches, "trilinear")
        coarse = GrainSet(tuple(dataclasses.replace(g, fine=None) for g in few().grains))  # as a plan uses them
        image = simulate_radiographs(coarse, few_grains.motions(coarse), geometry)[0].astype(float)
        jacobian = np.zeros((6 * n + 2, *image.shape))
        for (g, _, r0, r1, c0, c1), start in zip(patches.boxes, patches.offsets, strict=False):
            part = derivatives[:, start : start + (r1 - r0) * (c1 - c0)]
            jacobian[6 * g : 6 * g + 6, r0:r1, c0:c1] = part.reshape(6, r1 - r0, c1 - c0)
        jacobian[-2], jacobian[-1] = image, 1
        weights = SETTINGS.photons * np.exp(-image)
        expected = np.einsum("arc,brc,rc->ab", jacobian, jacobian, weights)
        dense = views.information(view).dense(gain=True)
        scale = np.sqrt(np.diagonal(expected))
        np.testing.assert_allclose(dense / np.outer(scale, scale), expected / np.outer(scale, scale), atol=1e-5)

    def test_information_adds_up_over_views(self):
        """The information of two views is the sum of theirs."""
        views = candidates()
        both = (views.information(2) + views.information(9)).dense(gain=True)
        apart = views.information(2).dense(gain=True) + views.information(9).dense(gain=True)
        np.testing.assert_allclose(both, apart)
        own = diagonal_blocks((views.information(2) + views.information(9)).matrix)
        np.testing.assert_allclose(own[1], both[6:12, 6:12])

    def test_sd_falls_with_more_views(self):
        views = candidates()
        assert np.all(sd(views, (0, 6, 9)) < sd(views, (0, 6)))

    def test_sd_falls_with_the_root_of_the_exposure(self):
        few_photons, many = candidates(photons=1e4), candidates(photons=4e4)
        np.testing.assert_allclose(sd(few_photons, (0, 6)), 2 * sd(many, (0, 6)), rtol=1e-3)

    def test_covariance_rotates_with_sample_and_views(self):
        """Rotating sample and views together rotates the covariance, and changes nothing else."""
        views = candidates()
        rotation = rotation_matrix([0, 0, np.pi / 2])
        rotated = GrainSet(tuple(rotate_quarter(g) for g in few().grains))
        a = views.covariances((2, 7))
        b = Candidates(rotated, circle(), SETTINGS).covariances((2 + 6, 7 + 6))
        both = np.kron(np.eye(2), rotation)
        scale = np.sqrt(np.einsum("nkk->nk", b))
        shape = scale[:, :, None] * scale[:, None, :]
        np.testing.assert_allclose(both @ a @ both.T / shape, b / shape, atol=2e-3)

    def test_unknown_gain_raises_sd(self):
        known, unknown = sd(candidates(gain=False), (0, 6)), sd(candidates(gain=True), (0, 6))
        assert np.all(unknown > known * (1 - 1e-9))
        assert unknown.max() > 1.0001 * known.max()
        assert np.all(unknown < 2 * known)

    def test_unknown_neighbours_raise_sd(self):
        """A grain with known neighbours has a smaller standard deviation than one with unknown neighbours."""
        views = candidates(gain=False)
        own = diagonal_blocks((views.information(0) + views.information(6)).matrix)
        alone = np.sqrt(np.einsum("nkk->nk", np.linalg.inv(own)))
        assert np.all(sd(views, (0, 6)) > alone * (1 - 1e-6))

    def test_model_error_raises_sd(self):
        assert np.all(sd(candidates(model_error=1.0), (0, 6)) > sd(candidates(), (0, 6)))

    def test_covariances_from_neighbours(self, monkeypatch):
        """With all neighbours they are exact; with fewer, approximate."""
        views = candidates()
        exact = sd(views, (0, 6))
        monkeypatch.setattr(fisher_information, "MAX_EXACT_UNKNOWNS", 0)
        np.testing.assert_allclose(sd(views, (0, 6)), exact, rtol=1e-4)
        monkeypatch.setattr(fisher_information, "COUPLED_NEIGHBOURS", 2)
        approximate = sd(views, (0, 6))
        assert np.all(approximate < exact * (1 + 1e-6))
        np.testing.assert_allclose(approximate, exact, rtol=0.1)

    def test_undetermined_directions_have_the_sd_of_the_prior(self):
        """One view of a parallel beam does not determine translation along it; the prior is a diameter."""
        parallel = Geometry.parallel([0.0, 90.0], few_grains.PANEL, few_grains.VOXEL)
        views = candidates(parallel)
        one = sd(views, (0,))
        np.testing.assert_allclose(one[:, 1], 2 * views.grain_arrays.radii, rtol=1e-3)
        assert one[:, 0].max() < 0.1 * few_grains.VOXEL

    def test_a_slice_has_three_unknowns(self):
        z = np.zeros((1, 30, 40), np.float32)
        labels = np.zeros(z.shape, np.int32)
        z[0, 5:15, 5:17], labels[0, 5:15, 5:17] = 1, 1
        z[0, 18:26, 22:35], labels[0, 18:26, 22:35] = 1, 2
        flat = grains_from_labels(few_grains.Volume(z, 0.1), labels, reach=0)
        geometry = Geometry.parallel([10.0, 55.0, 100.0], (1, 60), 0.1)
        slice_plan = plan(flat, geometry, PlanSettings(views=(2,), model_error=0))
        spread = slice_plan.get(2).sd
        assert np.all(spread[:, [2, 3, 4]] == 0)
        assert np.all((spread[:, [0, 1, 5]] > 0) & (spread[:, [0, 1, 5]] < 0.01))
        assert np.isinf(slice_plan.get(2).room[1])


def rotate_quarter(grain):
    """The grain rotated by 90° about z, voxel by voxel."""
    volume = grain.volume
    x, y, z = volume.center
    array = np.ascontiguousarray(np.rot90(volume.array, k=-1, axes=(1, 2)))
    rotated = few_grains.Volume(array, volume.voxel_size, (-y, x, z))
    c = grain.center
    return dataclasses.replace(grain, volume=rotated, center=np.array([-c[1], c[0], c[2]]))


class TestChoice:
    @pytest.mark.parametrize("count", [2, 4])
    def test_best_is_at_least_as_good_as_even(self, count):
        assert planned().get(count).criterion <= planned().get(count, "even").criterion * (1 + 1e-9)

    def test_best_pair_has_the_lowest_criterion(self):
        pairs, between = planned().pairs, angles_between(circle())
        assert planned().get(2).criterion == pytest.approx(pairs[between > 54].min())

    @pytest.mark.parametrize("count", [2, 4])
    def test_chosen_views_are_spread(self, count):
        s = planned().get(count)
        between = angles_between(circle()[list(s.indices)])[np.triu_indices(count, 1)]
        assert between.min() >= SETTINGS.spread * 180 / count - 1e-3

    def test_opposite_and_close_views_are_poor_pairs(self):
        """By the criterion itself, without the rule about the spread of views."""
        pairs = planned().pairs
        assert pairs[0, 0] > 5 * pairs[0, 6]
        assert pairs[0, 12] > 2 * pairs[0, 6]
        assert pairs[0, 1] > 1.2 * pairs[0, 6]

    def test_uncoupled_grains_give_a_similar_choice(self, monkeypatch):
        monkeypatch.setattr(view_selection, "MAX_COUPLED_OPERATIONS", 0)
        uncoupled = plan(few(), circle(), SETTINGS)
        assert not uncoupled.coupled
        assert planned().coupled
        assert uncoupled.get(4).criterion < 1.05 * planned().get(4).criterion

    def test_exchange_improves_a_poor_start(self):
        selector = ViewSelector.of(candidates())
        start = (0, 1, 2, 3)
        end = selector.improve(start)
        assert selector.conflicts(start) > 0
        assert selector.conflicts(end) == 0
        assert selector.cost(end) < 1.02 * planned().get(4).criterion

    def test_only_requested_counts_are_reported(self):
        assert [(len(s), s.kind) for s in planned().sets] == [(2, "best"), (2, "even"), (4, "best"), (4, "even")]

    def test_tables_of_motions_and_angles(self):
        table, angles = planned().to_table(), planned().angles_table()
        assert tuple(table.columns) == PLAN_COLUMNS
        assert len(table) == 4 * len(few())
        assert list(angles["views"]) == [2, 2, 4, 4]
        assert angles["angles_deg"].iloc[3] == "0 45 90 135"
        first = planned().get(2)
        np.testing.assert_allclose(table["sd_ux"][: len(few())], first.sd[:, 0])
        np.testing.assert_allclose(table["sd_wz"][: len(few())], np.rad2deg(first.sd[:, 5]))


class TestCandidates:
    def test_span_of_candidates_depends_on_the_beam(self):
        assert len(candidate_angles("cone", PlanSettings(step_deg=5))) == 72
        assert len(candidate_angles("parallel", PlanSettings(step_deg=5))) == 36
        np.testing.assert_allclose(candidate_angles("cone", PlanSettings(step_deg=40, span_deg=90)), [0, 40, 80])

    @pytest.mark.parametrize("beam", ["cone", "parallel"])
    def test_angles_are_those_of_the_scan(self, beam):
        angles = [0.0, 30.0, 200.0, 359.0]
        parallel = Geometry.parallel(angles, (4, 5), 0.1)
        geometry = few_grains.geometry(angles) if beam == "cone" else parallel
        np.testing.assert_allclose(geometry.azimuths_deg, angles, atol=1e-5)
        np.testing.assert_allclose(angles_between(geometry)[0], [0, 30, 20, 1], atol=1e-5)

    def test_candidates_from_the_views_of_a_scan(self):
        scan = few_grains.geometry(np.arange(352) * 360 / 352)
        own = nearest_views(scan, PlanSettings(step_deg=45))
        assert len(own) == 8
        assert np.abs(own.azimuths_deg - np.arange(8) * 45).max() < 0.6
        assert len(nearest_views(scan[[0, 5]], PlanSettings())) == 2

    def test_even_set_of_angles(self):
        angles = candidate_angles("cone", PlanSettings(step_deg=5))
        assert [angles[i] for i in even_set(angles, 4)] == [0, 45, 90, 135]
        assert even_set(np.array([0.0, 90.0, 180.0]), 4) is None


class TestCapture:
    def test_ranges_are_those_of_the_study(self):
        """Every range is a row of the study's table in which all grains were registered."""
        page = (Path(__file__).parents[2] / "docs" / "paper.md").read_text()
        study = page[page.index("<!-- begin capture -->") : page.index("<!-- end capture -->")]
        rows = [
            [cell.strip() for cell in line.strip("|").split("|")] for line in study.splitlines() if "views |" in line
        ]
        heads = rows[0]
        table = dict(re.findall(r"^\| (each[^|]*|all[^|]*) \| (.*) \|$", study, flags=re.MULTILINE))
        for c in capture_range.MEASURED_CAPTURES:
            column = heads.index(f"{c.views} views") - 1
            for diameters, degrees in c.ranges:
                cell = table[f"each up to {diameters:g} diameter, {degrees:g}°"].split("|")[column]
                assert cell.strip().startswith("100%"), (c, cell)
            assert table["all by 60 voxels"].split("|")[column].strip().startswith("100%")
            assert c.together == 60 / 20

    def test_other_numbers_of_views_use_the_next_lower_one(self):
        assert capture_range.expected_capture(5).views == 4
        assert capture_range.expected_capture(9).views == 6

    def test_room_is_the_distance_to_the_panel_s_edge(self):
        """The projection of the sample moved by the room touches the panel's edge."""
        packed = candidates().grain_arrays
        geometry = Geometry.parallel([0.0], (90, 90), few_grains.VOXEL)
        across, along = capture_range.room(packed, geometry)
        assert across > 0.5
        for axis, free in ((0, across), (2, along)):
            low, high = [], []
            for direction in (-1, 1):
                move = np.zeros(3)
                move[axis] = direction * free
                edge = geometry.project_points((packed.hulls + packed.centers[:, None] + move).reshape(-1, 3))[0]
                low.append((edge + 0.5).min())
                high.append((89.5 - edge).min())
            assert min(low + high) == pytest.approx(0, abs=1e-6)

    def test_no_room_if_a_projection_is_cut_off(self):
        geometry = Geometry.parallel([0.0], (20, 90), few_grains.VOXEL)
        assert capture_range.room(candidates().grain_arrays, geometry)[1] == 0


class TestBadInput:
    def test_more_views_than_candidates_are_refused(self):
        with pytest.raises(InputError, match="4 views wanted of 3 candidates; ask for fewer"):
            plan(few(), circle()[[0, 6, 12]], SETTINGS)

    def test_views_without_a_grain_are_refused(self):
        away = circle().window((5000, 5000), (40, 40))
        with pytest.raises(InputError, match="no candidate view sees a grain"):
            plan(few(), away, SETTINGS)

    def test_an_unplanned_number_of_views_is_refused(self):
        with pytest.raises(InputError, match="no best set of 3 views"):
            planned().get(3)

    @pytest.mark.parametrize("wrong", [{"photons": 0}, {"views": (1,)}, {"views": ()}, {"step_deg": 0}])
    def test_invalid_settings_are_refused(self, wrong):
        with pytest.raises(InputError):
            PlanSettings(**wrong)


@pytest.fixture(scope="module")
def experiment():
    case = simulate.small(seed=5)
    volume = reconstruct(case.reference(), case.scanner.grid, ReconstructSettings(sweeps=3)).volume
    return case, grains_from_labels(volume, segment(volume).labels)


class TestPredictionsAgainstSimulatedExperiments:
    """A packing simulated without voxels, reconstructed, segmented and tracked; six grains in five states each."""

    @pytest.mark.parametrize("views", [2, 4])
    @pytest.mark.parametrize("photons", [5e3, 2e5])
    def test_errors_are_as_large_as_predicted(self, experiment, views, photons):
        """Photon noise dominates at the small exposure, voxel blur at the large one."""
        case, grains = experiment
        case = dataclasses.replace(case, physics=dataclasses.replace(case.physics, photons=photons))
        h, angles = case.scanner.voxel_size, simulate.LATER_ANGLES_DEG[views]
        predicted = sd(Candidates(grains, case.scanner.geometry(angles), PlanSettings(photons=photons)), range(views))
        squares: list[list[float]] = [[], []]
        for number in range(STATES):
            truth = simulate.random(case.sample, 3 * h, 6.0, 50 + number)
            measured = track(grains, case.state(truth, angles, number + 1), settings=QUICK)
            errors = compare(measured, truth, h)
            assert errors.failures == 0
            squares[0].append(errors.translation_rms**2)
            squares[1].append(np.deg2rad(errors.rotation_rms_deg) ** 2)
        for square, part in zip(squares, (predicted[:, :3], predicted[:, 3:]), strict=True):
            ratio = np.sqrt(np.mean(square) / np.mean(part**2))
            assert 0.55 < ratio < 1.45, (views, photons, ratio)
