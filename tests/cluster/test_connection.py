"""Real Dask processes: the same results as one process, also after workers die, join late or spill to disk."""

import gc
import os
import shutil
import signal
import subprocess
import sys
from functools import cache

import numpy as np
import pytest
from typer.testing import CliRunner

from dask_workers import scheduler
from few_grains import VOXEL, grain_set, radiographs, small_motions
from grainmotion.cli.app import app
from grainmotion.cluster import distributed_iterate
from grainmotion.cluster.connection import ComputeConfig, connect
from grainmotion.errors import InputError
from grainmotion.experiment.config import read_experiment
from grainmotion.experiment.inputs import find_inputs
from grainmotion.experiment.scan_inputs import ScanInput
from grainmotion.io.results import read_motions_h5, read_reference
from grainmotion.io.stacks import find_stack
from grainmotion.model.geometry import Geometry
from grainmotion.model.volume import Volume
from grainmotion.reconstruction import slabs
from grainmotion.reconstruction.reconstruct import ReconstructSettings, reconstruct
from grainmotion.tracking.track import TrackSettings, track
from grainmotion.workflow.run import run
from tiny_experiment import TOML, write_tiny

distributed = pytest.importorskip("distributed")
dask = pytest.importorskip("dask")

QUICK = TrackSettings(search=False, fields=False, view_corrections="never")


@cache
def scan():
    return radiographs(grain_set(), small_motions(grain_set()))


@pytest.fixture(autouse=True)
def always_shared(monkeypatch):
    """Distribute grains to workers even for the small samples of these tests."""
    monkeypatch.setattr("grainmotion.cluster.dask_backend.MIN_VOXELS_TO_SHARE", 0)


def assert_same_motions(one, other):
    """Motions agree within 1e-6 voxel at the surface of any grain."""
    np.testing.assert_allclose(other.translations, one.translations, rtol=0, atol=1e-6 * VOXEL)
    np.testing.assert_allclose(other.rotations, one.rotations, rtol=0, atol=1e-7)
    np.testing.assert_array_equal(other.statuses, one.statuses)


class TestWorkers:
    def test_tracking_survives_a_late_and_a_killed_worker(self, tmp_path):
        """The only worker that holds grains is killed during the run, after another one has joined."""
        local = track(grain_set(), scan(), settings=QUICK)
        messages = []
        with scheduler() as workers, connect(ComputeConfig(workers.start().address), tmp_path) as cluster:

            def listen(message, done, total):
                messages.append(message)
                if len(messages) == 4:
                    workers.start()
                    cluster.executor.client.wait_for_workers(2, timeout=900)
                if len(messages) == 6:
                    workers.kill()

            distributed_motions = track(grain_set(), scan(), settings=QUICK, progress=listen, device=cluster.backend)
            assert cluster.executor.worker_count == 1
        assert len(messages) > 8
        assert_same_motions(local, distributed_motions)
        assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_reconstruction_survives_a_killed_and_a_late_worker(tmp_path, monkeypatch):
    monkeypatch.setattr(slabs, "SLAB_PLANES", 14)  # two slabs
    monkeypatch.setattr(distributed_iterate, "VIEWS_BETWEEN_CHECKPOINTS", 64)
    inputs = find_inputs(read_experiment(write_tiny(tmp_path / "tiny")))
    source, settings = inputs.reference, ReconstructSettings(method="accelerated")
    local = reconstruct(source.read()[0], inputs.grid, settings)
    messages = []
    with scheduler() as workers, connect(ComputeConfig(workers.start().start().address), tmp_path / "store") as cluster:
        cluster.executor.client.wait_for_workers(2, timeout=900)

        def listen(message, done, total):
            messages.append(message)
            if len(messages) == 12:  # between two checkpoints, which are 8 updates apart
                workers.kill()
            if len(messages) == 20:
                workers.start()

        many = cluster.reconstruct(source, inputs.grid, settings, listen)
    assert len(messages) == 52
    np.testing.assert_array_equal(many.volume.array, local.volume.array)
    assert many.residuals == local.residuals


def spilled(dask_worker):
    """Bytes that a worker has spilled to disk so far, and its process id."""
    return dask_worker.data.cumulative_metrics["disk-write", "bytes"], os.getpid()


def test_ctrl_c_is_left_to_the_command_that_started_the_workers(tmp_path):
    """In a terminal it reaches its workers too, which would print how they were interrupted."""

    def ignores_it(cluster):
        (answer,) = cluster.executor.client.run(lambda: signal.getsignal(signal.SIGINT) == signal.SIG_IGN).values()
        return answer

    with connect(ComputeConfig(workers=1), tmp_path / "own") as cluster:
        assert ignores_it(cluster)
    with scheduler() as workers, connect(ComputeConfig(workers.start().address), tmp_path / "other") as cluster:
        assert not ignores_it(cluster)
    assert signal.getsignal(signal.SIGINT) != signal.SIG_IGN


@pytest.mark.slow
def test_memory_limit_is_respected(tmp_path):
    """Data of twice the memory limit: the worker spills to disk and survives, and the result is the same."""
    rng = np.random.default_rng(0)
    views = Geometry.parallel(np.arange(6) * 30, (256, 128), 0.1)
    np.save(tmp_path / "scan.npy", rng.random((6, 256, 128), np.float32))
    source = ScanInput("scan", find_stack(tmp_path / "scan.npy"), None, None, "line-integrals", views)
    grid, settings = Volume.zeros((256, 128, 128), 0.1), ReconstructSettings(sweeps=1)
    one = reconstruct(source.read()[0], grid, settings)
    # 30 MB for data, besides the memory of Python itself
    small_memory = dask.config.set({"distributed.worker.memory.target": 0.03})
    with small_memory, connect(ComputeConfig(workers=1, memory="1GB"), tmp_path / "store") as cluster:
        (before,) = cluster.executor.client.run(spilled).values()
        many = cluster.reconstruct(source, grid, settings)
        (after,) = cluster.executor.client.run(spilled).values()
    assert after[0] > before[0] + 30e6
    assert after[1] == before[1]  # the same process: its nanny did not restart it
    np.testing.assert_array_equal(many.volume.array, one.volume.array)


class TestRun:
    """Whole runs from files, by one process and by two workers."""

    @pytest.fixture(scope="class", autouse=True)
    @classmethod
    def two_slabs(cls):
        """Thin slabs, so that the volume has two."""
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(slabs, "SLAB_PLANES", 14)
            yield

    @pytest.fixture(scope="class")
    @classmethod
    def by_one_process(cls, tmp_path_factory):
        """By one process: the experiment, a copy of its results before tracking, and all results."""
        path = write_tiny(
            tmp_path_factory.mktemp("one"), TOML.replace("search = false", "search = false\niterations = 3")
        )
        segmented = path.parent / "segmented"
        run(read_experiment(path), out=segmented, until="segment")
        shutil.copytree(segmented, path.parent / "local")
        return path, segmented, run(read_experiment(path), out=path.parent / "local", until="track")

    @pytest.fixture(scope="class")
    @classmethod
    def by_two_workers(cls, by_one_process, tmp_path_factory):
        """Folder of results of two workers, from the radiographs on."""
        out = tmp_path_factory.mktemp("many") / "out"
        result = CliRunner().invoke(app, ["run", str(by_one_process[0]), "--workers", "2", "--out", str(out), "-q"])
        assert result.exit_code == 0, result.output
        return out

    @pytest.mark.slow
    def test_same_reference(self, by_one_process, by_two_workers):
        path, _, local = by_one_process
        one, other = (read_reference(folder / "reference.h5") for folder in (local.folder, by_two_workers))
        assert one.volume.array.any()
        np.testing.assert_array_equal(other.volume.array, one.volume.array)
        assert other.residuals == one.residuals
        np.testing.assert_array_equal(other.labels, one.labels)
        assert not list(by_two_workers.glob(".shelf*"))
        # stages finished by workers are reused by one process
        assert run(read_experiment(path), out=by_two_workers).done == ()

    def test_same_motions_from_the_same_reference(self, by_one_process):
        path, segmented, local = by_one_process
        result = CliRunner().invoke(app, ["track", str(path), "--workers", "2", "--out", str(segmented), "-q"])
        assert result.exit_code == 0, result.output
        for name, motions in local.motions.items():
            assert_same_motions(motions, read_motions_h5(segmented / name / "motions.h5"))

    def test_same_motions_of_states_tracked_concurrently(self, by_one_process, monkeypatch, tmp_path):
        """A small sample: each state is tracked by one worker; both start from the reference."""
        monkeypatch.setattr("grainmotion.cluster.dask_backend.MIN_VOXELS_TO_SHARE", 1e9)
        shutil.copytree(by_one_process[0].parent, tmp_path / "tiny")
        path = tmp_path / "tiny" / "experiment.toml"
        path.write_text(
            path.read_text().replace('radiographs = "two.npy"', 'radiographs = "two.npy"\ninitial = "reference"')
        )
        segmented, messages = path.parent / "segmented", []
        local = run(read_experiment(path), out=path.parent / "local", until="track")
        for name in local.motions:
            shutil.rmtree(segmented / name, ignore_errors=True)
        concurrent = run(
            read_experiment(path), out=segmented, until="track", workplace=ComputeConfig(workers=2),
            progress=lambda message, done, total: messages.append(message),
        )  # fmt: skip
        assert {"tracking states side by side: one done", "tracking states side by side: two done"} <= set(messages)
        for name, motions in local.motions.items():
            assert_same_motions(motions, concurrent.motions[name])

    @pytest.mark.slow
    def test_same_motions_from_the_radiographs_on(self, by_one_process, by_two_workers):
        for name, motions in by_one_process[2].motions.items():
            assert_same_motions(motions, read_motions_h5(by_two_workers / name / "motions.h5"))


class TestComputeConfig:
    def test_scheduler_that_does_not_answer_is_refused(self, tmp_path, monkeypatch):
        monkeypatch.setattr("grainmotion.cluster.connection.SECONDS_TO_ANSWER", 1)
        path = write_tiny(tmp_path)
        result = CliRunner().invoke(app, ["run", str(path), "--scheduler", "tcp://127.0.0.1:9", "-q"])
        assert result.exit_code == 2
        assert "error: --scheduler tcp://127.0.0.1:9: no Dask scheduler answers there" in result.stderr
        assert "dask scheduler" in result.stderr
        assert not (tmp_path / "results").exists()

    @pytest.mark.parametrize(
        "address", ["nonsense", "127.0.0.1:port", "smoke://127.0.0.1:1", "tcp://127.0.0.1:9", "nowhere.json"]
    )
    def test_bad_addresses_are_refused(self, tmp_path, monkeypatch, address):
        monkeypatch.setattr("grainmotion.cluster.connection.SECONDS_TO_ANSWER", 1)
        with pytest.raises(InputError, match="no Dask scheduler answers"), connect(ComputeConfig(address), tmp_path):
            pass
        # a client left half open could deadlock when it is garbage-collected while Dask holds its lock
        clients = [client for client in gc.get_objects() if issubclass(type(client), distributed.Client)]
        assert all(client.status == "closed" for client in clients)

    def test_scheduler_without_workers_is_refused(self, tmp_path, monkeypatch):
        monkeypatch.setattr("grainmotion.cluster.connection.SECONDS_TO_FIRST_WORKER", 1)
        with (
            scheduler() as workers,
            pytest.raises(InputError, match="no workers; start some"),
            connect(ComputeConfig(workers.address), tmp_path),
        ):
            pass

    def test_missing_dask_is_named_with_a_remedy(self, tmp_path, monkeypatch):
        monkeypatch.setitem(sys.modules, "distributed", None)
        remedy = r"not installed; pip install 'grainmotion\[cluster\]'"
        with pytest.raises(InputError, match=remedy), connect(ComputeConfig(workers=2), tmp_path):
            pass

    def test_scheduler_and_worker_count_exclude_each_other(self):
        with pytest.raises(InputError, match="both are given"):
            ComputeConfig("tcp://there:8786", 2)
        with pytest.raises(InputError, match="at least 1, got 0"):
            ComputeConfig(workers=0)

    def test_memory_of_a_schedulers_workers_is_not_set_here(self):
        with pytest.raises(InputError, match=r"limit that they were started with.*dask worker --memory-limit"):
            ComputeConfig("tcp://there:8786", memory="8GB")

    def test_command_does_not_import_dask(self):
        everything = "import grainmotion as gm, grainmotion.workflow.run; [getattr(gm, name) for name in gm.__all__]"
        code = f"import sys; {everything}; sys.exit(any(m in sys.modules for m in ('dask', 'distributed')))"
        assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
