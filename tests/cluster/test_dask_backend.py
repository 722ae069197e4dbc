"""The Dask backend gives the results of the CPU bit by bit."""

import gc
from dataclasses import replace

import numpy as np
import pytest

from few_grains import grain_set, radiographs, small_motions
from grainmotion.cluster.dask_backend import DaskBackend
from grainmotion.cluster.shared_store import SharedStore
from grainmotion.model.grains import GrainSet
from grainmotion.model.pose import Pose
from grainmotion.objective.normal_matrix import PatchNormalMatrix, normal_matrix
from grainmotion.objective.residual import StateProblem
from grainmotion.projection.footprints import footprint_patches
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.projection.grains import assemble, differentiate_in_place, project_in_place
from grainmotion.tracking.multistage import MultistageFit
from grainmotion.tracking.track import TrackSettings, track
from grainmotion.uncertainty.rotation_identifiability import unconfirmed_rotations
from inline_work import InlineExecutor


def single(volume):
    return replace(volume, array=volume.array.astype(np.float32))


GRAINS = GrainSet(tuple(replace(g, volume=single(g.volume), fine=single(g.fine)) for g in grain_set().grains))
"""In single precision, as the pipeline's: of double numbers the order of sums shows in the last digit."""
SCAN = radiographs(GRAINS, small_motions(GRAINS))
STILL = Pose(np.zeros((len(GRAINS), 3)), np.tile(np.eye(3), (len(GRAINS), 1, 1)))
PANELS = SCAN.line_integrals.shape


@pytest.fixture(autouse=True)
def shared(monkeypatch):
    """Workers project samples however small."""
    monkeypatch.setattr("grainmotion.cluster.dask_backend.MIN_VOXELS_TO_SHARE", 0)


@pytest.fixture(params=[2, 3])
def workers(tmp_path, request):
    shelf = SharedStore(tmp_path)
    yield DaskBackend(InlineExecutor(request.param), shelf)
    shelf.close()


@pytest.fixture
def both(workers):
    """The grains here and with workers, and the derivatives of both."""
    one = GrainArrays.of(GRAINS)
    many = one.on(workers)
    patches = footprint_patches(one, STILL, SCAN.geometry, margin=2)
    walk = [differentiate_in_place(g, STILL, SCAN.geometry, patches, "trilinear") for g in (one, many)]
    return one, many, patches, walk


def test_every_grain_is_in_one_piece(workers):
    held = GrainArrays.of(GRAINS).on(workers).placed
    assert len(held.pieces) == workers.executor.worker_count
    assert sum(map(len, held.pieces)) == len(GrainArrays.of(GRAINS).images)


def test_voxels_are_handed_out_once(workers):
    """For all states, as long as as many workers are there; and not for longer than they live."""
    one = GrainArrays.of(GRAINS)
    held = one.on(workers).placed
    assert one.on(workers).placed is held
    workers.executor.worker_count += 1
    assert one.on(workers).placed is not held
    shared = workers.store.shared
    before = len(shared)
    other = one.coarsened(2)
    assert other.on(workers).placed is not held
    assert len(shared) == before + 1
    del other
    gc.collect()
    assert len(shared) == before


def test_same_projections(both):
    _, many, patches, ((values, derivatives), (far_values, far_derivatives)) = both
    np.testing.assert_array_equal(np.asarray(far_values), values)
    np.testing.assert_array_equal(np.asarray(far_derivatives.derivatives), derivatives.derivatives)
    alone = project_in_place(many, STILL, SCAN.geometry, patches, "trilinear")
    np.testing.assert_allclose(np.asarray(alone), values, atol=1e-6)
    np.testing.assert_array_equal(
        assemble(far_values, patches, SCAN.geometry, far_derivatives.backend), assemble(values, patches, SCAN.geometry)
    )


def test_same_products(both):
    _, _, _, ((_, here), (_, far)) = both
    n, rng = len(GRAINS), np.random.default_rng(0)
    images = rng.random(PANELS, np.float32)
    np.testing.assert_array_equal(far.gradient(images), here.gradient(images))
    np.testing.assert_array_equal(normal_matrix(far).toarray(), normal_matrix(here).toarray())
    x = rng.random((2, n, 6))
    np.testing.assert_array_equal(far.images(x), here.images(x))
    one, many = (PatchNormalMatrix(d) for d in (here, far))
    columns = x.reshape(2, -1).T
    np.testing.assert_array_equal(many @ columns, one @ columns)
    np.testing.assert_array_equal(many @ columns[:, 0], (one @ columns)[:, 0])
    np.testing.assert_array_equal(many.blocks(), one.blocks())


def test_some_grains_in_another_order(workers):
    rows = [2, 0, 2]
    one, many = (g.select(rows) for g in (GrainArrays.of(GRAINS), GrainArrays.of(GRAINS).on(workers)))
    pose = Pose(STILL.translations[rows], STILL.matrices[rows])
    patches = footprint_patches(one, pose, SCAN.geometry)
    here, far = (project_in_place(g, pose, SCAN.geometry, patches, "trilinear") for g in (one, many))
    np.testing.assert_array_equal(np.asarray(far), here)


def test_same_linearization(workers):
    """A whole evaluation, filtered, with its gradient; files of what nobody refers to are gone."""
    fit = MultistageFit.of(GRAINS, SCAN, TrackSettings())
    problem = StateProblem(fit.grains, replace(fit.target, sigma=2.0))
    far = replace(problem, grains=problem.grains.on(workers))
    here, there = problem.linearize(STILL), far.linearize(STILL)
    assert there.cost == here.cost
    np.testing.assert_array_equal(there.gradient, here.gradient)
    np.testing.assert_array_equal(there.hessian.toarray(), here.hessian.toarray())


def test_same_unconfirmed_rotations(workers):
    """Also of a ball, whose turns nothing confirms: its patches must be the same whoever lies in its piece."""
    grains = GrainSet(tuple(replace(g, volume=single(g.volume), fine=None) for g in grain_set(sphere=2).grains))
    fit = MultistageFit.of(grains, radiographs(grains, small_motions(grains)), TrackSettings())
    problem = StateProblem(fit.grains, replace(fit.target, sigma=0.7))
    seen = problem.evaluate_with_derivatives(STILL)
    far = replace(problem, grains=problem.grains.on(workers))
    one = unconfirmed_rotations(problem, STILL, seen)
    assert one[1].any()
    np.testing.assert_array_equal(unconfirmed_rotations(far, STILL, seen), one)


@pytest.mark.parametrize("search", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_same_motions(workers, search):
    settings = TrackSettings(search=search, device="cpu")
    one, many = track(GRAINS, SCAN, settings=settings), track(GRAINS, SCAN, settings=settings, device=workers)
    np.testing.assert_array_equal(many.translations, one.translations)
    np.testing.assert_array_equal(many.rotations, one.rotations)
    np.testing.assert_array_equal(many.statuses, one.statuses)
    np.testing.assert_array_equal(many.covariances, one.covariances)
    assert workers.executor.done.count("differentiate") > 4
