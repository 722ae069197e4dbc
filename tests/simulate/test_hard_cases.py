"""The hard cases (`simulate.hard_cases`): each has the effect of its summary and can be written as an experiment."""

import functools

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.spatial import cKDTree

from grainmotion.cli.demo import write_case
from grainmotion.cli.words import DatasetName
from grainmotion.errors import InputError
from grainmotion.io.geometry_csv import read_geometry
from grainmotion.io.motions_csv import read_motions
from grainmotion.model.motions import Status
from grainmotion.simulate import (
    HARD_CASES,
    LABORATORY_CASES,
    LATER_ANGLES_DEG,
    Sample,
    hard_case,
    hard_case_setup,
    hard_cases,
    line_integrals,
    record_line_integrals,
    small,
    transmission,
)

NAMES = (
    "noisy", "beam-hardening", "blur", "misaligned", "misaligned-state", "gain-drift", "gain-drift-views",
    "container", "missing", "broken", "near-spherical", "shear-band",
)  # fmt: skip
MANY_ANGLES_DEG = tuple(np.arange(200) * 1.8)


@pytest.fixture(scope="module", autouse=True)
def _stones_are_packed_once():
    with pytest.MonkeyPatch.context() as patch:
        once = functools.cache(hard_cases.stones)
        for module in (hard_cases, hard_case_setup):
            patch.setattr(module, "stones", once)
        yield


@functools.cache
def hard(name):
    return hard_case(name, seed=3)


def voxel(case):
    return case.case.scanner.voxel_size


def noise_free(case, sample=None, **options):
    return line_integrals(case.later if sample is None else sample, case.true_geometry(), **options)


def standardized(scan, fraction, physics):
    """(measured − expected) over the photon noise's standard deviation, where the sample is."""
    expected = -np.log(fraction)
    return ((scan.line_integrals - expected) * np.sqrt(physics.photons * fraction))[expected > 0.05]


class TestRegistry:
    def test_names_are_those_of_the_command_line(self):
        assert tuple(HARD_CASES) == NAMES + LABORATORY_CASES
        assert {name.value for name in DatasetName} == {"small", "paper", *HARD_CASES}
        for recipe in HARD_CASES.values():
            assert recipe.summary.endswith(".")

    @pytest.mark.parametrize("name", NAMES)
    def test_every_state_is_on_the_panel_and_has_its_true_motions(self, name):
        case = hard(name)
        assert case.name == name
        assert case.summary == HARD_CASES[name].summary
        assert np.array_equal(case.motions.labels, case.case.sample.labels)
        np.testing.assert_allclose(case.motions.centers, case.case.sample.centers)
        for particles, views in (
            (case.later.particles, case.true_geometry()),
            (case.later.particles, case.true_geometry(LATER_ANGLES_DEG[2])),
            (case.case.sample.particles, case.true_reference_geometry()[::15]),
        ):
            p = line_integrals(Sample(particles), views, subsamples=1)
            assert p[:, [0, -1]].max() < 1e-6
            assert p[:, :, [0, -1]].max() < 1e-6

    @pytest.mark.parametrize("name", ["misaligned-state", "gain-drift-views", "broken"])
    def test_the_same_seed_gives_the_same_case(self, name):
        again = hard_case(name, seed=3)
        assert np.array_equal(again.state().line_integrals, hard(name).state().line_integrals)
        assert not np.array_equal(again.state(number=2).line_integrals, again.state().line_integrals)
        other = hard_case(name, seed=4)
        assert not np.allclose(other.case.sample.centers, again.case.sample.centers)

    def test_unknown_names_are_refused(self):
        with pytest.raises(InputError, match="choose one of noisy"):
            hard_case("cold")
        with pytest.raises(InputError, match="scale"):
            hard_case("blur", scale="huge")
        with pytest.raises(InputError, match="takes none"):
            hard_case("broken", inclusion=1.5)

    def test_the_paper_s_scale_is_available(self):
        case = hard_case("near-spherical", scale="paper")
        assert len(case.case.sample) == 15
        assert case.nominal_geometry().shape == (280, 180)


class TestNoise:
    def test_noisy_has_an_snr_of_ten(self):
        case = hard("noisy")
        residual = case.state().line_integrals - noise_free(case)
        assert np.linalg.norm(noise_free(case)) / np.linalg.norm(residual) == pytest.approx(10, rel=0.05)

    @pytest.mark.parametrize("name", ["missing", "container"])
    def test_the_others_have_an_snr_of_fifty(self, name):
        case = hard(name)
        residual = case.state().line_integrals - noise_free(case)
        assert np.linalg.norm(noise_free(case)) / np.linalg.norm(residual) == pytest.approx(50, rel=0.06)


class TestDetector:
    def test_hardening_reduces_the_longest_path_by_a_fifth_in_both_states(self):
        case = hard("beam-hardening")
        physics = case.case.physics
        views = case.nominal_geometry(LATER_ANGLES_DEG[4] + LATER_ANGLES_DEG[2])
        straight = line_integrals(case.case.sample, views, subsamples=1)
        hardened = line_integrals(case.case.sample, views, subsamples=1, spectrum=physics.spectrum)
        longest = straight.argmax()
        assert 1 - hardened.flat[longest] / straight.flat[longest] == pytest.approx(0.2, abs=1e-3)
        thin = (straight > 0.01) & (straight < 0.05)
        assert (1 - hardened[thin] / straight[thin]).max() < 0.02
        assert len(physics.spectrum) == 4
        for sample, views, scan in (
            (case.case.sample, case.nominal_geometry(), case.reference()),
            (case.later, case.nominal_geometry(LATER_ANGLES_DEG[4]), case.state()),
        ):
            residual = standardized(scan, transmission(sample, views, spectrum=physics.spectrum), physics)
            assert residual.std() == pytest.approx(1, abs=0.05)
            assert standardized(scan, transmission(sample, views), physics).std() > 5

    def test_blur_is_one_pixel_in_both_states(self):
        case = hard("blur")
        for sample, views, scan in (
            (case.case.sample, case.nominal_geometry()[:4], case.reference().select([0, 1, 2, 3])),
            (case.later, case.nominal_geometry(LATER_ANGLES_DEG[4]), case.state()),
        ):
            sharp = transmission(sample, views)
            soft = np.stack([gaussian_filter(image, 1.0, mode="nearest") for image in sharp])
            assert standardized(scan, soft, case.case.physics).std() == pytest.approx(1, abs=0.05)
            assert standardized(scan, sharp, case.case.physics).std() > 2

    def test_gain_is_off_by_a_tenth(self):
        case = hard("gain-drift")
        assert case.gain in (0.9, 1.1)
        air = np.median(case.state().line_integrals[:, :, :3], axis=(1, 2))
        np.testing.assert_allclose(air, -np.log(case.gain), atol=1e-3)
        assert np.median(case.reference().line_integrals[:, :, :3]) == pytest.approx(0, abs=1e-3)
        counts = case.state_counts()
        ratio = (counts.counts - 100)[:, :, :3].mean() / (counts.flats - 100)[:, :, :3].mean()
        assert ratio == pytest.approx(case.gain, rel=2e-3)
        assert {hard_case("gain-drift", seed).gain for seed in range(3, 7)} == {0.9, 1.1}

    def test_gain_differs_from_view_to_view(self):
        case = hard("gain-drift-views")
        air = np.median(case.state().line_integrals[:, :, :3], axis=(1, 2))
        np.testing.assert_allclose(air, -np.log(case.beam()), atol=1e-3)
        assert case.beam(2000).std() == pytest.approx(0.1, rel=0.1)


class TestMisalignment:
    def test_the_panel_is_off_by_half_a_pixel_and_half_a_degree_in_both_states(self):
        case = hard("misaligned")
        for nominal, true in (
            (case.nominal_geometry(), case.true_reference_geometry()),
            (case.nominal_geometry(LATER_ANGLES_DEG[4]), case.true_geometry()),
        ):
            origin = true.project_points([[0, 0, 0]]) - nominal.project_points([[0, 0, 0]])
            np.testing.assert_allclose(origin, -0.5, atol=0.01)
            cosines = np.einsum("ni,ni->n", true.vectors[:, 6:9], nominal.vectors[:, 6:9]) / 0.25
            np.testing.assert_allclose(np.rad2deg(np.arccos(cosines)), 0.5, atol=1e-6)
        assert np.array_equal(case.state().geometry.vectors, case.nominal_geometry(LATER_ANGLES_DEG[4]).vectors)
        assert np.array_equal(case.reference().geometry.vectors, case.nominal_geometry().vectors)
        assert np.array_equal(case.state_counts().geometry.vectors, case.state().geometry.vectors)
        true = transmission(case.later, case.true_geometry())
        assert standardized(case.state(), true, case.case.physics).std() == pytest.approx(1, abs=0.05)

    def test_every_view_of_the_later_state_has_a_misalignment_of_its_own(self):
        case = hard("misaligned-state")
        np.testing.assert_allclose(case.true_reference_geometry().vectors, case.nominal_geometry().vectors, atol=1e-12)
        nominal, true = case.nominal_geometry(MANY_ANGLES_DEG), case.true_geometry(MANY_ANGLES_DEG)
        displacement = (true.project_points([[0, 0, 0]]) - nominal.project_points([[0, 0, 0]]))[:, 0]
        np.testing.assert_allclose(displacement.std(axis=0), 0.3, rtol=0.2)
        angles = np.arctan2(true.vectors[:, 1], true.vectors[:, 0]) - np.arctan2(
            nominal.vectors[:, 1], nominal.vectors[:, 0]
        )
        assert np.rad2deg(np.angle(np.exp(1j * angles))).std() == pytest.approx(0.1, rel=0.2)
        again = case.true_geometry(MANY_ANGLES_DEG, number=2)
        assert np.abs(again.vectors - true.vectors).max() > 0.01


class TestInclusions:
    def test_hard_cases_take_inclusions(self):
        assert all(p.inclusions for p in hard_case("blur", seed=3, inclusion=1.5).case.sample.particles)
        with pytest.raises(InputError, match="inclusion"):
            small(inclusion=-1.0)


class TestSample:
    def test_the_container_has_a_tenth_of_the_norm_touches_grains_and_moves_with_them(self):
        case = hard("container")
        before, after = case.case.sample.tube, case.later.tube
        grains = noise_free(case, Sample(case.later.particles), subsamples=1)
        wall = noise_free(case, Sample((), after), subsamples=1)
        assert np.linalg.norm(wall) / np.linalg.norm(grains) == pytest.approx(0.1, rel=0.05)
        reach = max(np.hypot(*p.shape.vertices[:, :2].T).max() for p in case.case.sample.particles)
        assert 0 <= before.inner_radius - reach < 0.3 * voxel(case)
        shift = np.subtract(after.center, before.center)
        assert np.linalg.norm(shift) == pytest.approx(3 * voxel(case))
        assert shift[2] == 0
        own = case.case.motions["random"].translations
        np.testing.assert_allclose(case.motions.translations - own, np.tile(shift, (6, 1)))

    def test_one_grain_is_missing(self):
        case = hard("missing")
        (label,) = case.missing
        absent = case.case.sample.particles[label - 1]
        masses = [sum(p.mass for p in s.particles) for s in (case.case.sample, case.later)]
        assert masses[0] - masses[1] == pytest.approx(absent.mass)
        assert np.isnan(case.motions.translations[label - 1]).all()
        assert case.motions.statuses[label - 1] == Status.ABSENT
        remaining = np.delete(np.arange(6), label - 1)
        np.testing.assert_allclose(
            case.later.centers, case.case.sample.centers[remaining] + case.motions.translations[remaining], atol=1e-12
        )

    def test_one_grain_broke_and_mass_is_conserved(self):
        case = hard("broken")
        (label,) = case.broken
        first, second = case.later.particles[label - 1 : label + 1]
        whole = case.case.sample.particles[label - 1]
        assert len(case.later) == 7
        assert first.mass + second.mass == pytest.approx(whole.mass, rel=1e-12)
        assert min(first.mass, second.mass) > 0.2 * whole.mass
        distance = cKDTree(first.shape.vertices).query(second.shape.vertices)[0].min()
        assert 1 * voxel(case) < distance < 6 * voxel(case)  # rotated by 15° each, the rims come nearer
        assert case.motions.statuses[label - 1] == Status.BROKEN
        assert case.motions.ok.sum() == 5

    def test_near_spherical_grains_are_balls_within_two_percent(self):
        for particle in hard("near-spherical").case.sample.particles:
            assert 1.0001 < particle.shape.semi_axes.max() / particle.shape.semi_axes.min() < 1.02
            assert particle.inclusions == ()

    def test_twenty_grains_have_a_shear_band(self):
        case = hard("shear-band")
        u = case.motions.translations / voxel(case)
        assert len(u) == 20
        order = np.argsort(case.motions.centers[:, 2])
        slip = np.linalg.norm(u[order[-3:]].mean(axis=0) - u[order[:3]].mean(axis=0))
        assert 4.5 < slip <= 6
        assert 4 < np.rad2deg(np.linalg.norm(case.motions.rotations, axis=1)).max() < 9


@pytest.mark.parametrize("name", ["misaligned", "missing"])
def test_a_hard_case_on_disk_has_nominal_views_and_true_motions(name, tmp_path):
    path = write_case(tmp_path, name, seed=3)
    case = hard(name)
    assert path == tmp_path / "experiment.toml"
    for views in (4, 2):
        nominal = read_geometry(tmp_path / f"{name}-{views}.csv", (96, 72))
        np.testing.assert_allclose(nominal.vectors, case.nominal_geometry(LATER_ANGLES_DEG[views]).vectors, atol=1e-9)
        truth = read_motions(tmp_path / f"{name}-{views}-truth.csv")
        np.testing.assert_allclose(truth.translations, case.motions.translations)
        assert np.array_equal(truth.statuses, case.motions.statuses)
    true = tmp_path / f"{name}-4-true-views.csv"
    assert true.exists() == (name == "misaligned")
    if name == "misaligned":
        np.testing.assert_allclose(read_geometry(true, (96, 72)).vectors, case.true_geometry().vectors, atol=1e-9)


def test_intensities_of_another_number_of_views_are_refused():
    case = hard("blur")
    with pytest.raises(InputError, match="intensity"):
        record_line_integrals(case.later, case.true_geometry(), case.case.physics, 0, beam=np.ones(3))
