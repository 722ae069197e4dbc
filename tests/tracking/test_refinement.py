"""Final refinement (`tracking.refinement`): from paused fits, with a robust loss, with the likelihood of counts."""

from dataclasses import replace

import numpy as np

from few_grains import VOXEL, errors, geometry, grain_set, radiographs, small_motions
from grainmotion.model.scan import Scan
from grainmotion.projection.grains import simulate_radiographs
from grainmotion.rotations import rotation_matrix, rotation_vector
from grainmotion.tracking.attempt import Job, approach, finish
from grainmotion.tracking.track import TrackSettings, track

TRUTH = small_motions(grain_set(finer=1))
QUICK = TrackSettings(search=False)


class TestPausedFits:
    def test_without_weak_directions_it_goes_on_to_the_end(self):
        """From a pose that is off by a hundredth of a voxel, to the motions of a fit that did not pause."""
        scan = radiographs(grain_set(), TRUTH)
        job = Job(grain_set(), scan, None, QUICK, None, None)
        near = approach(job)
        settled = finish(job, near).motions
        state = near.solution.state
        off = state.moved(state.translations + 0.01 * VOXEL, state.matrices)
        paused = replace(near.solution, state=off, settled=False, paused=True)
        motions = finish(job, replace(near, solution=paused)).motions
        assert motions.fit.costs[-1][0] == "free, to the end"
        assert motions.statuses.tolist() == settled.statuses.tolist()
        np.testing.assert_allclose(motions.translations, settled.translations, rtol=0, atol=2e-3 * VOXEL)
        variances = [np.einsum("nii->ni", m.covariances) for m in (motions, settled)]
        np.testing.assert_allclose(variances[0], variances[1], rtol=0.02)


class TestHuber:
    def test_outliers_bias_motions_less(self):
        """Zingers on one pixel in fifty, and an unknown object in one view."""
        scan = radiographs(grain_set(), TRUTH)
        rng = np.random.default_rng(3)
        images = scan.line_integrals.copy()
        outliers = rng.uniform(size=images.shape) < 0.02
        images[outliers] += rng.uniform(0.3, 1.0, outliers.sum()).astype(np.float32)
        images[1, 20:26, 10:40] += 0.5
        spoiled = Scan(images, scan.geometry)
        plain, robust = (
            track(grain_set(), spoiled, settings=replace(QUICK, loss=loss)) for loss in ("squares", "huber")
        )
        sizes = [np.sqrt((errors(m, TRUTH)[0] ** 2).mean()) for m in (plain, robust)]
        assert sizes[1] < 0.6 * sizes[0]
        assert plain.fit.downweighted == 0
        assert 0.01 < robust.fit.downweighted < 0.1

    def test_without_outliers_it_equals_least_squares(self):
        scan = radiographs(grain_set(), TRUTH)
        plain, robust = (track(grain_set(), scan, settings=replace(QUICK, loss=loss)) for loss in ("squares", "huber"))
        np.testing.assert_allclose(robust.translations, plain.translations, atol=0.01 * VOXEL)


class TestPoisson:
    PHOTONS = 300.0

    def scan(self):
        mean = self.PHOTONS * np.exp(-simulate_radiographs(grain_set(), TRUTH, geometry()))
        images = -np.log(np.maximum(np.random.default_rng(4).poisson(mean), 0.5) / self.PHOTONS)
        return Scan(images.astype(np.float32), geometry())

    def scores(self, measured):
        """Derivatives of minus the log-likelihood of the counts by every unknown, times its standard deviation."""
        counts = self.PHOTONS * np.exp(-self.scan().line_integrals.astype(float))

        def cost(k, step):
            moved = replace(measured, translations=measured.translations.copy(), rotations=measured.rotations.copy())
            moved.translations[k] += step[:3]
            moved.rotations[k] = rotation_vector(rotation_matrix(step[3:]) @ measured.matrices[k])
            m = measured.fit.response.apply(simulate_radiographs(grain_set(), moved, geometry()).astype(float))
            return float((counts * m + self.PHOTONS * np.exp(-m)).sum())

        derivatives = np.zeros((5, 6))
        for k in range(5):
            sd = np.sqrt(np.diagonal(measured.covariances[k]))
            for i, step in enumerate(0.3 * sd[:, None] * np.eye(6)):
                derivatives[k, i] = (cost(k, step) - cost(k, -step)) / 0.6
        return derivatives

    def test_ends_at_the_maximum_of_the_likelihood(self):
        """The score is zero there; least squares end elsewhere."""
        likely = track(grain_set(), self.scan(), settings=replace(QUICK, loss="poisson"))
        plain = track(grain_set(), self.scan(), settings=QUICK)
        assert likely.ok.all()
        scores = self.scores(likely)
        assert np.sqrt((scores**2).mean()) < 0.1
        assert np.sqrt((self.scores(plain) ** 2).mean()) > 2 * np.sqrt((scores**2).mean())
        u, _ = errors(likely, TRUTH)
        sd = np.sqrt(np.diagonal(likely.covariances, axis1=1, axis2=2))[:, :3] / VOXEL
        assert np.sqrt(((u / sd) ** 2).mean()) < 1.6
