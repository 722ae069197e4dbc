"""Real Dask processes: the same results as one process, whatever becomes of the workers."""

import gc
import os
import shutil
import signal
import subprocess
import sys
from contextlib import contextmanager

import numpy as np
import pytest
from typer.testing import CliRunner

from few_grains import grain_set, radiographs, small_motions
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

GRAINS = grain_set()
SCAN = radiographs(GRAINS, small_motions(GRAINS))
QUICK = TrackSettings(search=False, fields=False, view_corrections="never")
VOXEL = GRAINS.voxel_size


@pytest.fixture(autouse=True)
def shared(monkeypatch):
    """Workers project samples however small."""
    monkeypatch.setattr("grainmotion.cluster.dask_backend.MIN_VOXELS_TO_SHARE", 0)


class Workers:
    """Worker processes without anybody who starts them again."""

    def __init__(self, address):
        self.address, self.processes = address, []

    def start(self, memory="2GB"):
        command = [sys.executable, "-m", "distributed.cli.dask_worker", self.address, "--no-nanny", "--no-dashboard"]
        command += ["--nthreads", "1", "--memory-limit", memory]
        self.processes.append(subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL))
        return self

    def kill(self):
        """Take the first of them out, as a crash does."""
        os.kill(self.processes.pop(0).pid, signal.SIGKILL)


@contextmanager
def scheduler():
    with distributed.LocalCluster(n_workers=0, dashboard_address=None, silence_logs="CRITICAL") as local:
        workers = Workers(local.scheduler_address)
        try:
            yield workers
        finally:
            for process in workers.processes:
                process.kill()


def same(one, other):
    """Within 1e-6 voxel at any grain's surface."""
    np.testing.assert_allclose(other.translations, one.translations, rtol=0, atol=1e-6 * VOXEL)
    np.testing.assert_allclose(other.rotations, one.rotations, rtol=0, atol=1e-7)
    np.testing.assert_array_equal(other.statuses, one.statuses)


class TestWorkers:
    def test_one_dies_and_one_comes_late(self, tmp_path):
        """The only worker that holds anything is killed in mid-run, after another one has joined."""
        alone = track(GRAINS, SCAN, settings=QUICK)
        told = []
        with scheduler() as workers, connect(ComputeConfig(workers.start().address), tmp_path) as cluster:

            def listen(message, done, total):
                told.append(message)
                if len(told) == 4:
                    workers.start()
                    cluster.executor.client.wait_for_workers(2, timeout=900)
                if len(told) == 6:
                    workers.kill()

            many = track(GRAINS, SCAN, settings=QUICK, progress=listen, device=cluster.backend)
            assert len(cluster.executor.client.scheduler_info()["workers"]) == 1
        assert len(told) > 8
        same(alone, many)
        assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_one_dies_and_one_comes_late_while_reconstructing(tmp_path, monkeypatch):
    monkeypatch.setattr(slabs, "SLAB_PLANES", 14)  # two of them
    monkeypatch.setattr(distributed_iterate, "VIEWS_BETWEEN_CHECKPOINTS", 64)
    inputs = find_inputs(read_experiment(write_tiny(tmp_path / "tiny")))
    source, settings = inputs.reference, ReconstructSettings(method="accelerated")
    alone = reconstruct(source.read()[0], inputs.grid, settings)
    told = []
    with scheduler() as workers, connect(ComputeConfig(workers.start().start().address), tmp_path / "shelf") as cluster:
        cluster.executor.client.wait_for_workers(2, timeout=900)

        def listen(message, done, total):
            told.append(message)
            if len(told) == 12:  # between two times that slabs are stored, of 8 updates each
                workers.kill()
            if len(told) == 20:
                workers.start()

        many = cluster.reconstruct(source, inputs.grid, settings, listen)
    assert len(told) == 52
    np.testing.assert_array_equal(many.volume.array, alone.volume.array)
    assert many.residuals == alone.residuals


def spilled(dask_worker):
    """Bytes that a worker has put on disk so far, and its process."""
    return dask_worker.data.cumulative_metrics["disk-write", "bytes"], os.getpid()


@pytest.mark.slow
def test_memory_limit_is_respected(tmp_path):
    """Twice what a worker may hold of it in memory: it spills to disk and lives, and the result is the same."""
    rng = np.random.default_rng(0)
    views = Geometry.parallel(np.arange(6) * 30, (256, 128), 0.1)
    np.save(tmp_path / "scan.npy", rng.random((6, 256, 128), np.float32))
    source = ScanInput("scan", find_stack(tmp_path / "scan.npy"), None, None, "line-integrals", views)
    grid, settings = Volume.zeros((256, 128, 128), 0.1), ReconstructSettings(sweeps=1)
    one = reconstruct(source.read()[0], grid, settings)
    share = dask.config.set({"distributed.worker.memory.target": 0.03})  # 30 MB, beside what Python itself takes
    with share, connect(ComputeConfig(workers=1, memory="1GB"), tmp_path / "shelf") as cluster:
        (before,) = cluster.executor.client.run(spilled).values()
        many = cluster.reconstruct(source, grid, settings)
        (after,) = cluster.executor.client.run(spilled).values()
    assert after[0] > before[0] + 30e6
    assert after[1] == before[1]  # the same process: its nanny did not have to kill it
    np.testing.assert_array_equal(many.volume.array, one.volume.array)


class TestRun:
    """The whole job on disk, by one process and by two workers."""

    @pytest.fixture(scope="class", autouse=True)
    @classmethod
    def two_slabs(cls):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(slabs, "SLAB_PLANES", 14)
            yield

    @pytest.fixture(scope="class")
    @classmethod
    def once(cls, tmp_path_factory):
        """The experiment and what one process made of it: a copy of the results before tracking, and all of them."""
        path = write_tiny(
            tmp_path_factory.mktemp("once"), TOML.replace("search = false", "search = false\niterations = 3")
        )
        begun = path.parent / "begun"
        run(read_experiment(path), out=begun, until="segment")
        shutil.copytree(begun, path.parent / "alone")
        return path, begun, run(read_experiment(path), out=path.parent / "alone", until="track")

    @pytest.fixture(scope="class")
    @classmethod
    def many(cls, once, tmp_path_factory):
        """Results of two workers, from the radiographs on."""
        out = tmp_path_factory.mktemp("many") / "out"
        found = CliRunner().invoke(app, ["run", str(once[0]), "--workers", "2", "--out", str(out), "-q"])
        assert found.exit_code == 0, found.output
        return out

    @pytest.mark.slow
    def test_same_reference(self, once, many):
        path, _, alone = once
        one, other = (read_reference(folder / "reference.h5") for folder in (alone.folder, many))
        assert one.volume.array.any()
        np.testing.assert_array_equal(other.volume.array, one.volume.array)
        assert other.residuals == one.residuals
        np.testing.assert_array_equal(other.labels, one.labels)
        assert not list(many.glob(".shelf*"))
        # and what is there is not done again, by whomever it was done
        assert run(read_experiment(path), out=many).done == ()

    def test_same_motions_from_one_reference(self, once):
        path, begun, alone = once
        found = CliRunner().invoke(app, ["track", str(path), "--workers", "2", "--out", str(begun), "-q"])
        assert found.exit_code == 0, found.output
        for name, motions in alone.motions.items():
            same(motions, read_motions_h5(begun / name / "motions.h5"))

    def test_same_motions_of_states_side_by_side(self, once, monkeypatch, tmp_path):
        """Each tracked by one worker, for the sample is small; both start at the reference."""
        monkeypatch.setattr("grainmotion.cluster.dask_backend.MIN_VOXELS_TO_SHARE", 1e9)
        shutil.copytree(once[0].parent, tmp_path / "tiny")
        path = tmp_path / "tiny" / "experiment.toml"
        path.write_text(
            path.read_text().replace('radiographs = "two.npy"', 'radiographs = "two.npy"\ninitial = "reference"')
        )
        begun, told = path.parent / "begun", []
        alone = run(read_experiment(path), out=path.parent / "alone", until="track")
        for name in alone.motions:
            shutil.rmtree(begun / name, ignore_errors=True)
        many = run(
            read_experiment(path), out=begun, until="track", workplace=ComputeConfig(workers=2),
            progress=lambda message, done, total: told.append(message),
        )  # fmt: skip
        assert {"tracking states side by side: one done", "tracking states side by side: two done"} <= set(told)
        for name, motions in alone.motions.items():
            same(motions, many.motions[name])

    @pytest.mark.slow
    def test_same_motions_from_the_radiographs_on(self, once, many):
        for name, motions in once[2].motions.items():
            same(motions, read_motions_h5(many / name / "motions.h5"))


class TestWorkplace:
    def test_nobody_answers(self, tmp_path, monkeypatch):
        monkeypatch.setattr("grainmotion.cluster.connection.SECONDS_TO_ANSWER", 1)
        path = write_tiny(tmp_path)
        found = CliRunner().invoke(app, ["run", str(path), "--scheduler", "tcp://127.0.0.1:9", "-q"])
        assert found.exit_code == 2
        assert "error: --scheduler tcp://127.0.0.1:9: no Dask scheduler answers there" in found.stderr
        assert "dask scheduler" in found.stderr
        assert not (tmp_path / "results").exists()

    @pytest.mark.parametrize(
        "address", ["nonsense", "127.0.0.1:port", "smoke://127.0.0.1:1", "tcp://127.0.0.1:9", "nowhere.json"]
    )
    def test_no_address(self, tmp_path, monkeypatch, address):
        monkeypatch.setattr("grainmotion.cluster.connection.SECONDS_TO_ANSWER", 1)
        with pytest.raises(InputError, match="no Dask scheduler answers"), connect(ComputeConfig(address), tmp_path):
            pass
        # no half-open client: collected while Dask holds its lock, one would block for good
        left = [one for one in gc.get_objects() if isinstance(one, distributed.Client)]
        assert all(client.status == "closed" for client in left)

    def test_no_workers(self, tmp_path, monkeypatch):
        monkeypatch.setattr("grainmotion.cluster.connection.SECONDS_TO_FIRST_WORKER", 1)
        with (
            scheduler() as workers,
            pytest.raises(InputError, match="no workers; start some"),
            connect(ComputeConfig(workers.address), tmp_path),
        ):
            pass

    def test_dask_is_missing(self, tmp_path, monkeypatch):
        monkeypatch.setitem(sys.modules, "distributed", None)
        remedy = r"not installed; pip install 'grainmotion\[cluster\]'"
        with pytest.raises(InputError, match=remedy), connect(ComputeConfig(workers=2), tmp_path):
            pass

    def test_either_or(self):
        with pytest.raises(InputError, match="both are given"):
            ComputeConfig("tcp://there:8786", 2)
        with pytest.raises(InputError, match="at least 1, got 0"):
            ComputeConfig(workers=0)

    def test_nobody_but_this_process_needs_no_dask(self):
        everything = "import grainmotion as gm, grainmotion.workflow.run; [getattr(gm, name) for name in gm.__all__]"
        code = f"import sys; {everything}; sys.exit(any(m in sys.modules for m in ('dask', 'distributed')))"
        assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
