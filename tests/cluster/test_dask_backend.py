"""The Dask backend gives the results of the CPU bit by bit."""

import gc
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from few_grains import grain_set, radiographs, small_motions
from grainmotion.cluster.dask_backend import DaskBackend
from grainmotion.cluster.shared_store import SharedStore
from grainmotion.model.compact_volume import CompactVolume
from grainmotion.model.grains import GrainSet
from grainmotion.model.pose import Pose
from grainmotion.objective.normal_matrix import PatchNormalMatrix, normal_matrix
from grainmotion.objective.residual import StateProblem
from grainmotion.projection.footprints import footprint_patches
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.projection.grains import assemble, differentiate_in_place, project_in_place
from grainmotion.rotations import rotation_matrix
from grainmotion.tracking.alternative_fits import fit_alternatives
from grainmotion.tracking.multistage import MultistageFit
from grainmotion.tracking.track import TrackSettings, track
from grainmotion.uncertainty.rotation_identifiability import unconfirmed_rotations
from inline_executor import InlineExecutor


def single(volume):
    """The volume in single precision."""
    return replace(volume, array=volume.array.astype(np.float32))


@cache
def grains():
    """In single precision, as in a run: double precision shows the order of sums in the last digit."""
    return GrainSet(tuple(replace(g, volume=single(g.volume), fine=single(g.fine)) for g in grain_set().grains))


@cache
def scan():
    return radiographs(grains(), small_motions(grains()))


REST_POSE = Pose(np.zeros((5, 3)), np.tile(np.eye(3), (5, 1, 1)))


@pytest.fixture(autouse=True)
def always_shared(monkeypatch):
    """Distribute grains to workers even for the small samples of these tests."""
    monkeypatch.setattr("grainmotion.cluster.dask_backend.MIN_VOXELS_TO_SHARE", 0)


@pytest.fixture(params=[2, 3])
def workers(tmp_path, request):
    """A Dask backend of two or three workers, run in this process."""
    store = SharedStore(tmp_path)
    yield DaskBackend(InlineExecutor(request.param), store)
    store.close()


@pytest.fixture
def both(workers):
    """Grains on the CPU and on workers, their patches, and the values and derivatives of both."""
    one = GrainArrays.of(grains())
    many = one.on(workers)
    patches = footprint_patches(one, REST_POSE, scan().geometry, margin=2)
    projected = [differentiate_in_place(g, REST_POSE, scan().geometry, patches, "trilinear") for g in (one, many)]
    return one, many, patches, projected


def test_voxels_are_divided_among_all_workers(workers):
    placed = GrainArrays.of(grains()).on(workers).placed
    assert len(placed.pieces) == workers.executor.worker_count
    assert sum(map(len, placed.pieces)) == len(GrainArrays.of(grains()).images)


def test_voxels_are_distributed_once(workers):
    """They are distributed again if the number of workers changes, and released with the grains."""
    one = GrainArrays.of(grains())
    placed = one.on(workers).placed
    assert one.on(workers).placed is placed
    workers.executor.worker_count += 1
    assert one.on(workers).placed is not placed
    shared = workers.store.shared
    before = len(shared)
    other = one.coarsened(2)
    assert other.on(workers).placed is not placed
    assert len(shared) == before + 1
    del other
    gc.collect()
    assert len(shared) == before


def test_compact_voxels_go_to_the_workers_as_they_are(workers):
    """The client never writes them out; workers do, and project the same."""
    some = (replace(g, fine=CompactVolume.of(g.fine)) for g in grains().grains)
    one = GrainArrays.of(GrainSet(tuple(some)), fine=True)
    many = one.on(workers)
    assert many.backend is workers
    patches = footprint_patches(one, REST_POSE, scan().geometry, margin=2)
    expected = project_in_place(one, REST_POSE, scan().geometry, patches, "trilinear")
    found = project_in_place(many, REST_POSE, scan().geometry, patches, "trilinear")
    np.testing.assert_array_equal(np.asarray(found), expected)
    assert len(list(workers.store.folder.iterdir())) <= 3 * workers.executor.worker_count


def test_same_projections(both):
    _, many, patches, ((values, jacobian), (worker_values, worker_jacobian)) = both
    np.testing.assert_array_equal(np.asarray(worker_values), values)
    np.testing.assert_array_equal(np.asarray(worker_jacobian.derivatives), jacobian.derivatives)
    values_only = project_in_place(many, REST_POSE, scan().geometry, patches, "trilinear")
    np.testing.assert_allclose(np.asarray(values_only), values, atol=1e-6)
    np.testing.assert_array_equal(
        assemble(worker_values, patches, scan().geometry, worker_jacobian.backend),
        assemble(values, patches, scan().geometry),
    )


def test_same_products_with_the_jacobian(both):
    _, _, _, ((_, on_cpu), (_, on_workers)) = both
    n, rng = len(grains()), np.random.default_rng(0)
    images = rng.random(scan().line_integrals.shape, np.float32)
    np.testing.assert_array_equal(on_workers.gradient(images), on_cpu.gradient(images))
    np.testing.assert_array_equal(normal_matrix(on_workers).toarray(), normal_matrix(on_cpu).toarray())
    x = rng.random((2, n, 6))
    np.testing.assert_array_equal(on_workers.images(x), on_cpu.images(x))
    one, many = (PatchNormalMatrix(d) for d in (on_cpu, on_workers))
    columns = x.reshape(2, -1).T
    np.testing.assert_array_equal(many @ columns, one @ columns)
    np.testing.assert_array_equal(many @ columns[:, 0], (one @ columns)[:, 0])
    np.testing.assert_array_equal(many.blocks(), one.blocks())


def test_selected_grains_in_another_order(workers):
    rows = [2, 0, 2]
    one, many = (g.select(rows) for g in (GrainArrays.of(grains()), GrainArrays.of(grains()).on(workers)))
    pose = Pose(REST_POSE.translations[rows], REST_POSE.matrices[rows])
    patches = footprint_patches(one, pose, scan().geometry)
    on_cpu, on_workers = (project_in_place(g, pose, scan().geometry, patches, "trilinear") for g in (one, many))
    np.testing.assert_array_equal(np.asarray(on_workers), on_cpu)


def test_same_linearization(workers):
    """Cost, gradient and Hessian of a filtered evaluation."""
    fit = MultistageFit.of(grains(), scan(), TrackSettings())
    problem = StateProblem(fit.grains, replace(fit.target, sigma=2.0))
    on_workers = replace(problem, grains=problem.grains.on(workers))
    expected, result = problem.linearize(REST_POSE), on_workers.linearize(REST_POSE)
    assert result.cost == expected.cost
    np.testing.assert_array_equal(result.gradient, expected.gradient)
    np.testing.assert_array_equal(result.hessian.toarray(), expected.hessian.toarray())


def test_same_unconfirmed_rotations(workers):
    """Also for a ball, whose rotations are undetermined: its patches are the same beside any other grains."""
    grains = GrainSet(tuple(replace(g, volume=single(g.volume), fine=None) for g in grain_set(sphere=2).grains))
    fit = MultistageFit.of(grains, radiographs(grains, small_motions(grains)), TrackSettings())
    problem = StateProblem(fit.grains, replace(fit.target, sigma=0.7))
    evaluation = problem.evaluate_with_derivatives(REST_POSE)
    on_workers = replace(problem, grains=problem.grains.on(workers))
    expected = unconfirmed_rotations(problem, REST_POSE, evaluation)
    assert expected[1].any()
    np.testing.assert_array_equal(unconfirmed_rotations(on_workers, REST_POSE, evaluation), expected)


def test_same_fits_of_alternative_poses(workers):
    """Two alternatives of one grain and one of another, which workers fit where the grains' voxels are."""
    fit = MultistageFit.of(grains(), scan(), TrackSettings())
    problem = StateProblem(fit.grains, replace(fit.target, sigma=0.7))
    on_workers = replace(problem, grains=problem.grains.on(workers))
    owners, matrices = (
        np.array([0, 0, 2]),
        rotation_matrix(np.array([[0.1, 0.0, 0.0], [0.0, 3.1, 0.0], [0.0, 0.2, 1.5]])),
    )
    expected, found = (
        fit_alternatives(p, REST_POSE, problem.evaluate(REST_POSE), owners, matrices, p.grains, np.ones(3, bool))
        for p in (problem, on_workers)
    )
    for name, values in vars(expected).items():
        np.testing.assert_array_equal(getattr(found, name), values)


@pytest.mark.parametrize("search", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_same_motions(workers, search):
    settings = TrackSettings(search=search, device="cpu")
    expected, motions = (track(grains(), scan(), settings=settings, device=d) for d in (None, workers))
    np.testing.assert_array_equal(motions.translations, expected.translations)
    np.testing.assert_array_equal(motions.rotations, expected.rotations)
    np.testing.assert_array_equal(motions.statuses, expected.statuses)
    np.testing.assert_array_equal(motions.covariances, expected.covariances)
    assert workers.executor.done.count("differentiate") > 4


def test_same_strains(workers):
    """Stages with strains run on the client's processor, those before them on the workers."""
    settings = TrackSettings(search=False, alternatives=False, strain=True, device="cpu")
    expected, motions = (track(grains(), scan(), settings=settings, device=d) for d in (None, workers))
    np.testing.assert_array_equal(motions.strains, expected.strains)
    np.testing.assert_array_equal(motions.strain_covariances, expected.strain_covariances)
    assert workers.executor.done.count("differentiate") > 4
