"""States tracked concurrently: the motions of one process, in whatever order the states are finished."""

from dataclasses import replace

import numpy as np
import pytest

from few_grains import grain_set
from grainmotion.backends.cpu import CPU
from grainmotion.cluster.connection import ComputeConfig
from grainmotion.cluster.shared_store import SharedStore
from grainmotion.cluster.state_tasks import State, track_distributed
from grainmotion.errors import InputError
from grainmotion.experiment.config import read_experiment
from grainmotion.experiment.inputs import find_inputs
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.volume import Volume
from grainmotion.segmentation.extraction import store_contiguously
from grainmotion.segmentation.grain_cutting import cut_grains
from grainmotion.tracking.track import TrackSettings
from grainmotion.workflow import tracking_stage
from grainmotion.workflow.context import RunContext
from grainmotion.workflow.provenance import StageCache
from grainmotion.workflow.reference_stages import reconstruct_stage, segment_stage
from grainmotion.workflow.run import run
from inline_executor import InlineExecutor
from scenes import one_body
from tiny_experiment import TOML, write_tiny

STATE = """
[[states]]
name = "{name}"
radiographs = "one.tif"
geometry = "one.csv"
initial = "{initial}"
"""
HEAD = TOML[: TOML.index("[[states]]")].replace("search = false", "search = false\niterations = 2")


class RecordingCluster:
    """A cluster inside this process that records the states it is given and where each starts."""

    backend, cut, shares = None, staticmethod(cut_grains), False

    def __init__(self, folder):
        self.store, self.asked = SharedStore(folder), []

    def one_worker_tracks_a_state(self, grains):
        return not self.shares

    def together(self, grains):
        return False

    def track(self, grains, states, settings):
        self.asked.append({state.name: state.after or state.starts({})[0] for state in states})
        results = list(track_distributed(InlineExecutor(), self.store, grains, states, settings))
        return reversed(results)  # the last state is finished first


def tiny(folder, **initials):
    """States of an experiment, and the results of one process up to the grains."""
    text = HEAD + "".join(STATE.format(name=name, initial=initial) for name, initial in initials.items())
    experiment = read_experiment(write_tiny(folder, text))
    run(experiment, until="segment")
    return experiment


def context_of(experiment, cluster):
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


def by_one_process(experiment):
    """The motions that one process gives, written to another folder."""
    return run(experiment, out=experiment.output.parent / "one-process", until="track").motions


def assert_same_motions(motions_by_state, expected):
    assert list(motions_by_state) == list(expected)
    for name, motions in expected.items():
        np.testing.assert_array_equal(motions_by_state[name].translations, motions.translations)
        np.testing.assert_array_equal(motions_by_state[name].rotations, motions.rotations)
        np.testing.assert_array_equal(motions_by_state[name].covariances, motions.covariances)


def test_independent_states_are_tracked_together(tmp_path):
    """Two states start from the reference; the third waits for the first only."""
    experiment = tiny(tmp_path, a="reference", b="previous", c="reference")
    cluster = RecordingCluster(tmp_path / "store")
    context = context_of(experiment, cluster)
    motions = track_states(context)
    assert cluster.asked == [{"a": None, "b": ("a",), "c": None}]
    assert_same_motions(motions, by_one_process(experiment))
    assert sorted(context.done) == ["a/track", "b/track", "c/track"]
    again = context_of(experiment, cluster)
    assert_same_motions(track_states(again), motions)  # loaded from the files
    assert (again.done, again.reused) == ([], ["a/track", "b/track", "c/track"])
    assert len(cluster.asked) == 1


def test_chained_states_and_shared_samples_are_tracked_one_by_one(tmp_path):
    cluster = RecordingCluster(tmp_path / "store")
    track_states(context_of(tiny(tmp_path / "chain", a="previous", b="previous"), cluster))
    cluster.shares = True
    track_states(context_of(tiny(tmp_path / "many", a="reference", b="reference"), cluster))
    assert not cluster.asked


def test_finished_states_are_reused(tmp_path):
    """A state whose predecessor is finished starts from the predecessor's file."""
    experiment = tiny(tmp_path, a="reference", b="previous", c="reference")
    cluster = RecordingCluster(tmp_path / "store")
    first = track_states(context_of(experiment, None))
    for name in ("b", "c"):
        (experiment.output / name / "motions.csv").unlink()
    context = context_of(experiment, cluster)
    assert_same_motions(track_states(context), first)
    assert context.done == ["c/track", "b/track"]
    (asked,) = cluster.asked
    assert isinstance(asked["b"], Motions)
    np.testing.assert_array_equal(asked["b"].translations, first["a"].translations)


def test_error_names_the_state(tmp_path):
    experiment = tiny(tmp_path, a="reference")
    scan, _ = find_inputs(experiment).states[0].read()
    wrong = Motions.identity(np.array([7, 8, 9]), np.zeros((3, 3)))
    store, states = SharedStore(tmp_path / "store"), [State("a", scan, "wrong.csv", starts=lambda tracked: (wrong,))]
    with pytest.raises(InputError, match=r"states\.a\.initial \(wrong\.csv\)"):
        list(track_distributed(InlineExecutor(), store, grain_set(), states, TrackSettings()))


def test_sample_is_sent_with_background_in_one_file(tmp_path, monkeypatch):
    """Tracking on a worker uses the CPU; voxels of all grains are contiguous in one stored file."""
    arrived = []

    def record(grains, scan, start, settings, *, device):
        arrived.append((grains, device))
        return Motions.identity(grains.labels, grains.centers)

    monkeypatch.setattr("grainmotion.cluster.state_tasks.track", record)
    contiguous = [replace(grain, fine=None) for grain in grain_set().grains]
    store_contiguously(contiguous)
    sample = GrainSet(tuple(contiguous), one_body(Volume(np.ones((40, 40, 40)), 0.1), True))
    scan, _ = find_inputs(tiny(tmp_path, a="reference")).states[0].read()
    store = SharedStore(tmp_path / "store")
    list(track_distributed(InlineExecutor(), store, sample, [State("a", scan, "reference")], TrackSettings()))
    ((grains, device),) = arrived
    assert device == CPU
    assert grains.background_moves
    np.testing.assert_array_equal(grains.background.array, sample.background.array)
    for one, other in zip(grains.grains, contiguous, strict=True):
        np.testing.assert_array_equal(one.volume.array, other.volume.array)
    assert len({id(grain.volume.array.base) for grain in grains.grains}) == 1


def test_waiting_states_are_passed_over(tmp_path):
    """A state waits until the state it starts from is finished; others are tracked meanwhile."""
    offered = []

    class RecordingExecutor(InlineExecutor):
        def as_completed(self, more):
            first, second, third = more(), more(), more()
            offered.append([name and name[0] for name in (first, second, third)])
            yield second
            offered.append([more(), more()])
            yield first
            after = more()
            offered.append([after[0], more()])
            yield after

    scan, _ = find_inputs(tiny(tmp_path, a="reference")).states[0].read()
    states = [State("a", scan, "reference"), State("b", scan, "previous", ("a",), lambda tracked: (tracked["a"],))]
    states.append(State("c", scan, "reference"))
    results = track_distributed(
        RecordingExecutor(), SharedStore(tmp_path / "store"), grain_set(), states, TrackSettings(search=False)
    )
    assert [name for name, _ in results] == ["c", "a", "b"]
    assert offered == [["a", "c", None], [None, None], ["b", None]]


def with_images(experiment, name, change, *states):
    """The experiment; the radiographs of these states are changed, and are a file of this name."""
    folder = experiment.folder
    np.save(folder / name, change(find_inputs(experiment).states[0].radiographs.read()))
    path = folder / "experiment.toml"
    text = path.read_text()
    for state in states:
        head, tail = text.split(f'name = "{state}"', 1)
        text = head + f'name = "{state}"' + tail.replace("one.tif", name, 1)
    path.write_text(text)
    return read_experiment(path)


def upside_down(images):
    return images[:, ::-1]


def test_each_state_is_checked_once_its_start_is_known(tmp_path):
    """States that do not fit are refused as in one process, also one that starts from the motions of another."""
    experiment = tiny(tmp_path, a="reference", b="previous", c="reference", d="previous", e="previous", f="reference")
    experiment = with_images(experiment, "flipped.npy", upside_down, "b", "c", "e")
    cluster = RecordingCluster(tmp_path / "store")
    context = context_of(experiment, cluster)
    motions = track_states(context)
    assert [set(states) for states in cluster.asked] == [{"a", "b", "d", "e", "f"}]  # b and e wait for their start
    assert sorted(context.refused) == ["b", "c", "e"]
    assert_same_motions(motions, by_one_process(experiment))
    for name in context.refused:
        assert "the state was not tracked: its views do not fit the reference" in motions[name].reasons[0]


def test_states_are_fixed_and_refused_by_processes_too(tmp_path):
    pytest.importorskip("distributed")
    experiment = with_images(
        tiny(tmp_path, a="reference", b="previous", c="reference"), "flipped.npy", upside_down, "b"
    )
    experiment = with_images(experiment, "no-beam.npy", lambda images: np.full_like(images, 130), "c")
    experiment = experiment.checked(force=False, try_fixes=True)
    by_processes = run(experiment, until="track", workplace=ComputeConfig(workers=2))
    expected = run(experiment, out=tmp_path / "one-process", until="track")
    assert by_processes.findings == expected.findings
    assert [expected.motions[name].usable.all() for name in "abc"] == [True, True, False]
    assert set(expected.motions["c"].statuses) == {"not-fitted"}
    for name, motions in expected.motions.items():
        np.testing.assert_array_equal(by_processes.motions[name].statuses, motions.statuses)
        np.testing.assert_allclose(by_processes.motions[name].translations, motions.translations, atol=1e-6)
