"""States side by side: what one process finds, whoever tracks them and in whatever order they are done."""

from dataclasses import replace

import numpy as np
import pytest

from few_grains import grain_set
from grainmotion.backends.cpu import CPU
from grainmotion.cluster.shared_store import SharedStore
from grainmotion.cluster.state_tasks import State, track_distributed
from grainmotion.errors import InputError
from grainmotion.experiment.config import read_experiment
from grainmotion.experiment.inputs import find_inputs
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.volume import Volume
from grainmotion.segmentation.extraction import store_contiguously
from grainmotion.segmentation.label_refinement import fine_grains
from grainmotion.tracking.track import TrackSettings
from grainmotion.workflow import tracking_stage
from grainmotion.workflow.context import RunContext
from grainmotion.workflow.provenance import StageCache
from grainmotion.workflow.reference_stages import reconstruct_stage, segment_stage
from grainmotion.workflow.run import run
from inline_work import InlineExecutor
from tiny_experiment import TOML, write_tiny

STATE = """
[[states]]
name = "{name}"
radiographs = "one.tif"
geometry = "one.csv"
initial = "{initial}"
"""
HEAD = TOML[: TOML.index("[[states]]")].replace("search = false", "search = false\niterations = 2")


class Side:
    """A cluster of this process alone; which states it is asked for, and from where each starts."""

    backend, cut, shares = None, staticmethod(fine_grains), False

    def __init__(self, folder):
        self.store, self.asked = SharedStore(folder), []

    def one_worker_tracks_a_state(self, grains):
        return not self.shares

    def track(self, grains, states, settings):
        self.asked.append({state.name: state.start for state in states})
        found = list(track_distributed(InlineExecutor(), self.store, grains, states, settings))
        return reversed(found)  # the last is there first


def tiny(folder, **initials):
    """States of an experiment, and the results of one process up to the grains."""
    text = HEAD + "".join(STATE.format(name=name, initial=initial) for name, initial in initials.items())
    experiment = read_experiment(write_tiny(folder, text))
    run(experiment, until="segment")
    return experiment


def job_of(experiment, cluster):
    folder = experiment.output
    return RunContext(experiment, find_inputs(experiment), folder, StageCache(folder), None, cluster=cluster)


def track_states(context):
    """The motions of all states, after the stages of the reference, which are done."""
    reference = segment_stage(context, reconstruct_stage(context))
    context.reused.clear()
    tracked = tracking_stage.track_side_by_side(context, reference)
    for name in [table.name for table in context.tables.states if table.name not in tracked]:
        tracked[name] = context.complete(tracking_stage.track_stage(context, reference, name, tracked))()
    return {table.name: tracked[table.name].motions for table in context.tables.states}


def by_one(experiment):
    """What one process finds, elsewhere."""
    return run(experiment, out=experiment.output.parent / "alone", until="track").motions


def same(found, other):
    assert list(found) == list(other)
    for name, motions in other.items():
        np.testing.assert_array_equal(found[name].translations, motions.translations)
        np.testing.assert_array_equal(found[name].rotations, motions.rotations)
        np.testing.assert_array_equal(found[name].covariances, motions.covariances)


def test_states_that_need_not_wait(tmp_path):
    """Two start at the reference, one after the first: it waits for that alone."""
    experiment = tiny(tmp_path, a="reference", b="previous", c="reference")
    side = Side(tmp_path / "shelf")
    job = job_of(experiment, side)
    found = track_states(job)
    assert side.asked == [{"a": None, "b": "a", "c": None}]
    same(found, by_one(experiment))
    assert sorted(job.done) == ["a/track", "b/track", "c/track"]
    again = job_of(experiment, side)
    same(track_states(again), found)  # from the files
    assert (again.done, again.reused) == ([], ["a/track", "b/track", "c/track"])
    assert len(side.asked) == 1


def test_one_after_the_other_where_each_waits_or_grains_are_many(tmp_path):
    side = Side(tmp_path / "shelf")
    track_states(job_of(tiny(tmp_path / "chain", a="previous", b="previous"), side))
    side.shares = True
    track_states(job_of(tiny(tmp_path / "many", a="reference", b="reference"), side))
    assert not side.asked


def test_what_is_there_is_not_done_again(tmp_path):
    """A state whose predecessor is there starts from its file."""
    experiment = tiny(tmp_path, a="reference", b="previous", c="reference")
    side = Side(tmp_path / "shelf")
    first = track_states(job_of(experiment, None))
    for name in ("b", "c"):
        (experiment.output / name / "motions.csv").unlink()
    job = job_of(experiment, side)
    same(track_states(job), first)
    assert job.done == ["c/track", "b/track"]
    (asked,) = side.asked
    assert isinstance(asked["b"], Motions)
    np.testing.assert_array_equal(asked["b"].translations, first["a"].translations)


def test_an_error_names_the_state(tmp_path):
    experiment = tiny(tmp_path, a="reference")
    scan, _ = find_inputs(experiment).states[0].read()
    wrong = Motions.identity(np.array([7, 7, 8]), np.zeros((3, 3)))
    shelf, states = SharedStore(tmp_path / "shelf"), [State("a", scan, "wrong.csv", wrong)]
    with pytest.raises(InputError, match=r"states\.a\.initial \(wrong\.csv\)"):
        list(track_distributed(InlineExecutor(), shelf, grain_set(), states, TrackSettings()))


def test_the_sample_arrives_whole(tmp_path, monkeypatch):
    """With its background, on the processor, its voxels end to end and in one file."""
    arrived = []

    def told(grains, scan, start, settings, *, device):
        arrived.append((grains, device))
        return Motions.identity(grains.labels, grains.centers)

    monkeypatch.setattr("grainmotion.cluster.state_tasks.track", told)
    laid = [replace(grain, fine=None) for grain in grain_set().grains]
    store_contiguously(laid)
    whole = GrainSet(tuple(laid), background=Volume(np.ones((40, 40, 40)), 0.1), background_moves=True)
    scan, _ = find_inputs(tiny(tmp_path, a="reference")).states[0].read()
    shelf = SharedStore(tmp_path / "shelf")
    list(track_distributed(InlineExecutor(), shelf, whole, [State("a", scan, "reference", None)], TrackSettings()))
    ((grains, device),) = arrived
    assert device == CPU
    assert grains.background_moves
    np.testing.assert_array_equal(grains.background.array, whole.background.array)
    for one, other in zip(grains.grains, laid, strict=True):
        np.testing.assert_array_equal(one.volume.array, other.volume.array)
    assert len({id(grain.volume.array.base) for grain in grains.grains}) == 1


def test_no_more_at_once_than_there_are_workers(tmp_path):
    """A state that waits is passed over until the one it starts from is there."""
    asked = []

    class Busy(InlineExecutor):
        def as_completed(self, more):
            first, second, third = more(), more(), more()
            asked.append([name and name[0] for name in (first, second, third)])
            yield second
            asked.append([more(), more()])
            yield first
            after = more()
            asked.append([after[0], more()])
            yield after

    scan, _ = find_inputs(tiny(tmp_path, a="reference")).states[0].read()
    states = [State("a", scan, "reference", None), State("b", scan, "previous", "a")]
    states.append(State("c", scan, "reference", None))
    found = track_distributed(Busy(), SharedStore(tmp_path / "shelf"), grain_set(), states, TrackSettings(search=False))
    assert [name for name, _ in found] == ["c", "a", "b"]
    assert asked == [["a", "c", None], [None, None], ["b", None]]
