"""Calls shared out to workers give the results of one process, to the bit, and leave no files."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from few_grains import grain_set, radiographs, small_motions
from grainmotion.cluster.shared_calls import call_each
from grainmotion.cluster.shared_store import SharedStore
from grainmotion.model.compact_volume import CompactVolume
from grainmotion.model.grains import GrainSet
from grainmotion.model.pose import Pose
from grainmotion.model.task_map import each, shared_among
from grainmotion.objective.residual import StateProblem
from grainmotion.projection import grain_tasks
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.tracking import self_likeness
from grainmotion.tracking.alternative_fits import fit_alternatives
from grainmotion.tracking.multistage import MultistageFit
from grainmotion.tracking.track import TrackSettings
from grainmotion.uncertainty.rotation_identifiability import unconfirmed_rotations
from inline_executor import InlineExecutor


def total(image, factor):
    return float(image.sum()) * factor


@pytest.fixture
def shared(tmp_path):
    """An executor whose workers make independent calls, as within `connect`."""
    store, executor = SharedStore(tmp_path), InlineExecutor()
    with shared_among(partial(call_each, executor, store)):
        yield executor
    assert not list(store.folder.iterdir()), "large arrays travel by files, which are gone once the calls are made"
    store.close()


def test_calls_are_tasks(shared):
    function = partial(total, np.ones(10_000))
    assert each(function, (k for k in (1, 2))) == [1e4, 2e4]
    assert each(function, [3]) == [3e4], "one call is not worth sending"
    assert shared.done == ["_call", "_call"]


def single(volume):
    return replace(volume, array=volume.array.astype(np.float32))


def grains(kind):
    """The same grains with finer voxels in single precision, or compact ones."""
    some = [replace(g, volume=single(g.volume), fine=single(g.fine)) for g in grain_set().grains]
    if kind == "compact":
        some = [replace(g, fine=CompactVolume.of(g.fine)) for g in some]
    return GrainSet(tuple(some))


@pytest.mark.parametrize("kind", ["single", "compact"])
def test_workers_try_other_poses_of_their_share_of_the_grains(tmp_path, monkeypatch, kind):
    monkeypatch.setattr(grain_tasks, "ROWS_OF_A_TASK", 4)
    sample = grains(kind)
    fit = MultistageFit.of(sample, radiographs(sample, small_motions(sample)), TrackSettings())
    problem = StateProblem(fit.fine_grains, fit.target)
    pose = Pose(np.zeros((5, 3)), np.tile(np.eye(3), (5, 1, 1)))
    evaluation = problem.evaluate(pose)
    owners, turned = np.array([0, 0, 3, 4]), np.tile(np.diag([1.0, -1.0, -1.0]), (4, 1, 1))
    alone = unconfirmed_rotations(problem, pose, evaluation)
    wanted = np.ones(len(owners), bool)
    fits = fit_alternatives(problem, pose, evaluation, owners, turned, problem.grains, wanted)
    store, executor = SharedStore(tmp_path), InlineExecutor()
    with shared_among(partial(call_each, executor, store)):
        np.testing.assert_array_equal(unconfirmed_rotations(problem, pose, evaluation), alone)
        assert len(executor.done) == 2
        found = fit_alternatives(problem, pose, evaluation, owners, turned, problem.grains, wanted)
    assert len(executor.done) == 4
    np.testing.assert_array_equal(found.matrices, fits.matrices)
    np.testing.assert_array_equal(found.deviations, fits.deviations)
    store.close()


def test_workers_find_the_symmetries_of_their_share_of_the_grains(shared, monkeypatch):
    monkeypatch.setattr(self_likeness, "GRAINS_OF_A_CALL", 2)
    sample = grains("single")
    arrays = GrainArrays.of(sample)
    self_likeness.find_symmetries(sample.grains, arrays, range(5))
    assert shared.done == ["_call"] * 3
    for row, grain in enumerate(sample.grains):
        alone = self_likeness.near_symmetries(arrays, row)
        found = self_likeness.known_symmetries(grain, arrays, row)
        np.testing.assert_array_equal(found.matrices, alone.matrices)
