"""Laboratory samples (`simulate.laboratory_cases`): each is what its summary says, and its truth is true."""

import dataclasses
import functools
import json

import numpy as np
import pytest

from grainmotion.cli.demo import write_case
from grainmotion.errors import InputError
from grainmotion.experiment.config import read_experiment
from grainmotion.experiment.inputs import find_inputs
from grainmotion.io.geometry_csv import read_geometry
from grainmotion.io.motions_csv import read_motions
from grainmotion.model.geometry import Geometry
from grainmotion.model.motions import Status
from grainmotion.model.strain import tensors
from grainmotion.simulate import (
    LABORATORY_CASES,
    LATER_ANGLES_DEG,
    Particle,
    Sample,
    attenuation_volume,
    disc,
    gaps,
    hard_case,
    hard_case_setup,
    label_volume,
    laboratory_cases,
    line_integrals,
    misalignment,
    sphere,
)

VOXEL = 0.125
CUT = ("tall", "wide")


@pytest.fixture(scope="module", autouse=True)
def _stones_are_packed_once():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(laboratory_cases, "stones", functools.cache(laboratory_cases.stones))
        yield


@functools.cache
def made(name):
    return hard_case(name, seed=3)


def mass(sample):
    return sum(p.mass for p in sample.particles)


class TestAll:
    @pytest.mark.parametrize("name", LABORATORY_CASES)
    def test_grains_conserve_their_mass_and_move_as_told(self, name):
        case = made(name)
        sample, motions = case.case.sample, case.motions
        assert np.array_equal(motions.labels, sample.labels)
        np.testing.assert_allclose(motions.centers, sample.centers, atol=1e-12)
        there = np.flatnonzero(~np.isin(motions.labels, case.missing))
        assert len(there) == len(case.later)
        before = [sample.particles[k] for k in there]
        # a strain without change of volume to first order changes it in the second
        tolerance = 5e-3 if case.motions.strains is not None else 1e-9
        np.testing.assert_allclose([p.mass for p in case.later.particles], [p.mass for p in before], rtol=tolerance)
        np.testing.assert_allclose(
            case.later.centers, motions.centers[there] + motions.translations[there], atol=1e-9 * (1 + len(there))
        )
        for k, old, new in zip(there, before, case.later.particles, strict=True):
            strain = np.zeros((3, 3)) if motions.strains is None else tensors(motions.strains[k])
            c, u, matrix = motions.centers[k], motions.translations[k], motions.matrices[k]
            points = (old.shape.outline - c) @ (matrix @ (np.eye(3) + strain)).T + c + u
            if case.name != "round":  # an ellipsoid's outline is that of its box
                np.testing.assert_allclose(new.shape.outline, points, atol=1e-9)

    @pytest.mark.parametrize("name", LABORATORY_CASES)
    def test_grains_are_on_the_panel_unless_it_is_what_makes_the_case(self, name):
        case = made(name)
        whole = case.whole(), case.whole(LATER_ANGLES_DEG[2])
        if name in CUT:
            assert all(0.15 * len(w) < w.sum() < 0.5 * len(w) for w in whole)
        else:
            assert all(w.all() for w in whole)
        assert case.name == name
        assert case.summary.endswith(".")

    def test_one_seed_gives_one_case(self):
        first, second, other = (hard_case("gone", seed) for seed in (3, 3, 4))
        assert first.missing == second.missing
        assert np.array_equal(first.state().line_integrals, second.state().line_integrals)
        assert not np.allclose(first.case.sample.centers, other.case.sample.centers)

    def test_inclusions_are_refused(self):
        with pytest.raises(InputError, match="takes none"):
            hard_case("wet", inclusion=1.5)

    def test_the_larger_scale_has_more_grains_and_views(self):
        setup = hard_case_setup.Setup(3, "paper", "random", None, None)
        case = laboratory_cases.combined(setup)
        assert len(case.case.sample) == 15
        assert len(case.nominal_geometry()) == 90
        assert case.whole().all()


class TestFieldOfView:
    def test_the_panel_sees_the_middle_of_the_tall_sample_across_its_whole_width(self):
        p = line_integrals(made("tall").case.sample, made("tall").nominal_geometry()[:4], subsamples=1)
        assert p[:, [0, -1]].max() > 0.3
        assert p[:, :, [0, -1]].max() == 0

    def test_the_panel_is_narrower_than_the_wide_sample(self):
        p = line_integrals(made("wide").case.sample, made("wide").nominal_geometry()[:4], subsamples=1)
        assert p[:, [0, -1]].max() == 0
        assert p[:, :, [0, -1]].max() > 0.2

    def test_the_tall_sample_is_compressed(self):
        case = made("tall")
        z, uz = case.motions.centers[:, 2], case.motions.translations[:, 2]
        assert np.polyfit(z, uz, 1)[0] == pytest.approx(-0.03, abs=0.01)


class TestBodies:
    def test_pistons_touch_the_grains_and_move_as_told(self):
        case = made("platens")
        strokes = case.body_motions
        assert np.array_equal(strokes.labels, [1, 2])
        for sample, shift in ((case.case.sample, 0), (case.later, 1)):
            grains = np.concatenate([p.shape.vertices for p in sample.particles])[:, 2]
            lower, upper = (p.shape.vertices[:, 2] for p in sample.bodies)
            assert lower.max() <= grains.min() + 1e-9
            assert upper.min() >= grains.max() - 1e-9
            np.testing.assert_allclose(
                [p.center for p in sample.bodies], strokes.centers + shift * strokes.translations, atol=1e-12
            )
        assert -2 * VOXEL - 1e-9 <= strokes.translations[1, 2] < -VOXEL
        assert strokes.translations[0, 2] <= 0
        assert case.facts["stroke"] == pytest.approx(-strokes.translations[1, 2])
        assert all(p.attenuation == pytest.approx(0.2) for p in case.case.sample.bodies)

    def test_bodies_attenuate_and_have_no_label(self):
        grid = made("platens").case.scanner.grid
        ball, plate = Particle(sphere(1.0, 2), 0.1), Particle(disc(1.0, -2.0, -1.0), 0.2)
        alone, both = Sample((ball,)), Sample((ball,), bodies=(plate,))
        views = made("platens").nominal_geometry()[:2]
        apart = line_integrals(alone, views) + line_integrals(Sample((plate,)), views)
        np.testing.assert_allclose(line_integrals(both, views), apart, atol=1e-4)
        assert both.labels.tolist() == [1]
        assert np.array_equal(label_volume(both, grid), label_volume(alone, grid))
        assert attenuation_volume(both, grid).array.sum() * VOXEL**3 == pytest.approx(ball.mass + plate.mass, rel=0.02)

    def test_a_disc_is_nearly_a_cylinder(self):
        assert disc(2.0, 1.0, 4.0).volume == pytest.approx(np.pi * 12, rel=5e-3)
        np.testing.assert_allclose(disc(2.0, 1.0, 4.0).centroid, [0, 0, 2.5], atol=1e-12)


class TestLiquid:
    def test_grains_in_the_liquid_attenuate_as_dry_ones_do(self):
        wet, plain = made("wet").case.sample, made("plain").case.sample
        np.testing.assert_allclose(wet.centers, plain.centers)
        liquid = wet.tube.attenuation
        assert liquid == pytest.approx(0.4 * plain.particles[0].attenuation)
        assert wet.particles[0].attenuation + liquid == pytest.approx(plain.particles[0].attenuation)
        reach = max(np.hypot(*p.shape.vertices[:, :2].T).max() for p in wet.particles)
        assert wet.tube.inner_radius == 0
        assert reach < wet.tube.outer_radius

    def test_the_upper_half_of_the_liquid_drains(self):
        case = made("drains")
        assert case.later.tube.top == case.facts["level"] == 0.0
        assert case.case.sample.tube.top > 100
        liquid = Sample((), case.later.tube)
        p = line_integrals(liquid, case.nominal_geometry((0.0,)), subsamples=1)[0]
        assert p[60:].max() == 0
        assert p[20].max() == pytest.approx(2 * 26 * VOXEL * 0.04, rel=0.02)


class TestGrains:
    def test_sizes_are_from_half_to_one_and_a_half_of_the_mean(self):
        volumes = np.array([p.shape.volume for p in made("sizes").case.sample.particles])
        diameters = np.cbrt(6 * volumes / np.pi) / VOXEL
        assert diameters.min() < 14
        assert diameters.max() > 26
        assert 10.4 < diameters.min() < diameters.max() < 31.6

    def test_a_third_of_the_grains_is_absent(self):
        case = made("gone")
        rows = np.array(case.missing) - 1
        assert len(rows) == 3
        assert (case.motions.statuses[rows] == Status.ABSENT).all()
        assert np.isnan(case.motions.translations[rows]).all()
        assert case.motions.ok.sum() == 6
        lost = sum(case.case.sample.particles[k].mass for k in rows)
        assert mass(case.case.sample) - mass(case.later) == pytest.approx(lost)

    def test_strains_are_five_percent_without_change_of_volume(self):
        strains = tensors(made("soft").motions.strains)
        np.testing.assert_allclose(np.trace(strains, axis1=1, axis2=2), 0, atol=1e-12)
        np.testing.assert_allclose(np.abs(np.linalg.eigvalsh(strains)).max(axis=1), 0.05)

    def test_half_of_the_grains_is_faint(self):
        values = np.array([p.attenuation for p in made("materials").case.sample.particles]) / 0.1
        assert (values == 1).sum() == 4
        assert ((values >= 0.25) & (values <= 0.4)).sum() == 4

    def test_round_grains_are_ellipsoids_that_hardly_touch(self):
        sample = made("round").case.sample
        ratios = [p.shape.semi_axes.max() / p.shape.semi_axes.min() for p in sample.particles]
        assert 1.02 < min(ratios) < max(ratios) < 1.4
        assert gaps(sample).min() > -1e-6


class TestScan:
    def test_the_sample_sinks_by_a_voxel_during_the_reference_scan(self):
        case = made("settling")
        views, nominal = case.true_reference_geometry(), case.nominal_geometry()
        rows = (views.project_points([[0, 0, 0]]) - nominal.project_points([[0, 0, 0]]))[:, 0, 0]
        np.testing.assert_allclose(rows, np.linspace(0.5, -0.5, 45), atol=0.01)
        assert np.array_equal(case.reference().geometry.vectors, nominal.vectors)
        np.testing.assert_allclose(case.true_geometry().vectors, case.state().geometry.vectors, atol=1e-12)

    @pytest.mark.parametrize("beam", ["cone", "parallel"])
    def test_a_creeping_sample_is_a_scanner_that_moves_the_other_way(self, beam):
        distances = {"source_to_axis": 60.0, "source_to_detector": 240.0} if beam == "cone" else {}
        views = getattr(Geometry, beam)((0.0, 40.0, 80.0), (40, 40), 0.5 if beam == "cone" else 0.125, **distances)
        creep = np.array([0.3, -0.2, 0.4])
        point = np.array([[0.7, 0.2, -0.5]])
        seen = misalignment.crept(views, creep).project_points(point)[:, 0]
        expected = [views[k].project_points(point + share * creep)[0, 0] for k, share in enumerate((-0.5, 0, 0.5))]
        np.testing.assert_allclose(seen, expected, atol=1e-9)

    def test_combined_has_all_its_flaws(self):
        case = made("combined")
        assert all(len(p.inclusions) == 1 for p in case.case.sample.particles)
        assert case.case.sample.tube == case.later.tube
        assert case.case.sample.tube.attenuation == pytest.approx(0.03)
        assert case.case.physics.blur == 0.7
        assert len(case.case.physics.spectrum) == 4
        quiet = dataclasses.replace(case, read_noise=0.0)
        noise = (case.state().line_integrals - quiet.state().line_integrals)[:, :, :4]
        assert noise.std() == pytest.approx(0.004, rel=0.1)
        loud, still = (c.reference_counts().darks for c in (case, quiet))
        photons = case.case.physics.photons * case.case.physics.counts_per_photon
        assert np.sqrt(loud.var() - still.var()) / photons == pytest.approx(0.004, rel=0.05)


class TestFiles:
    @pytest.mark.parametrize("name", ["platens", "soft", "settling", "drains"])
    def test_a_case_on_disk_can_be_read_as_an_experiment(self, name, tmp_path):
        path = write_case(tmp_path, name, seed=3)
        case = made(name)
        inputs = find_inputs(read_experiment(path))
        scan, _ = inputs.reference.read()
        assert scan.line_integrals.shape == (45, *case.case.scanner.panel)
        facts = json.loads((tmp_path / "case.json").read_text())
        assert facts == {"name": name, "seed": 3, "summary": case.summary, "facts": dict(case.facts)}
        truth = read_motions(tmp_path / f"{name}-4-truth.csv")
        np.testing.assert_allclose(truth.translations, case.motions.translations)
        bodies = tmp_path / f"{name}-2-bodies-truth.csv"
        assert bodies.exists() == (name == "platens")
        assert (tmp_path / "reference-true-views.csv").exists() == (name == "settling")
        if name == "platens":
            np.testing.assert_allclose(read_motions(bodies).translations, case.body_motions.translations)
        if name == "soft":
            np.testing.assert_allclose(truth.strains, case.motions.strains)
        if name == "settling":
            true = read_geometry(tmp_path / "reference-true-views.csv", case.case.scanner.panel)
            np.testing.assert_allclose(true.vectors, case.true_reference_geometry().vectors, atol=1e-9)
