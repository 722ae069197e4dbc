"""What a dry run tells is what a run then does; it writes nothing."""

import shutil

import numpy as np
import pytest

from grainmotion.cluster.connection import ComputeConfig
from grainmotion.cluster.worker_limits import WorkerLimits
from grainmotion.experiment.config import read_experiment
from grainmotion.io.tiff import read_tiff, write_tiff
from grainmotion.workflow.dry_run import planned_run
from grainmotion.workflow.estimates import estimate, logged_times, sizes
from grainmotion.workflow.run import run
from tiny_experiment import write_tiny

OUTPUTS = '\n[output]\nexports = ["vtk", "tiff", "dem", "mechanics"]\nrebuild = true\n'


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    path = write_tiny(tmp_path_factory.mktemp("dry") / "tiny")
    run(read_experiment(path), until="track")
    return path


@pytest.fixture
def copied(finished, tmp_path):
    return shutil.copytree(finished.parent, tmp_path / "tiny") / "experiment.toml"


def stages(path, **keywords):
    """Names of the stages that would be kept and done, and why."""
    planned = planned_run(read_experiment(path), **keywords).planned
    return [s.name for s in planned if s.kept], {s.name: s.why for s in planned if not s.kept}


def contents(folder):
    return {path: (path.stat().st_mtime_ns, path.read_bytes()) for path in folder.rglob("*") if path.is_file()}


def add_settings(path, text):
    path.write_text(path.read_text() + text)


def test_nothing_is_written_and_all_is_done_without_results(copied):
    shutil.rmtree(copied.parent / "results")
    before = contents(copied.parent)
    kept, done = stages(copied)
    assert kept == []
    assert set(done.values()) == {"not done yet"}
    assert contents(copied.parent) == before
    assert not (copied.parent / "results").exists()


@pytest.mark.parametrize(
    ("settings", "until"),
    [("", "reconstruct"), ("", "segment"), ("", "track"), ("", "report"), (OUTPUTS, "report")],
)
def test_stages_are_those_of_a_run(copied, settings, until):
    """Also in a folder that was moved, as this copy was."""
    add_settings(copied, settings)
    before = contents(copied.parent)
    kept, done = stages(copied, until=until)
    assert contents(copied.parent) == before
    result = run(read_experiment(copied), until=until)
    assert (kept, list(done)) == (list(result.reused), list(result.done))
    again, nothing = stages(copied, until=until)
    assert (sorted(again), nothing) == (sorted([*kept, *done]), {})


class TestWhy:
    def test_a_file_changed(self, copied):
        run(read_experiment(copied), until="segment")  # the folder was moved: the files are known from now on
        image = read_tiff(copied.parent / "one.tif")
        _touch_known(copied)
        write_tiff(copied.parent / "one.tif", (image + 1).astype(np.uint16))
        _, done = stages(copied, until="track")
        assert done["one/track"] == "one.tif changed"
        assert done["two/track"] == "one/track is done again"

    def test_a_setting_changed(self, copied):
        copied.write_text(copied.read_text().replace("search = false", "search = false\niterations = 7"))
        kept, done = stages(copied, until="track")
        assert "segment" in kept
        assert done["one/track"] == "its settings changed"

    def test_a_file_is_gone(self, copied):
        (copied.parent / "results" / "one" / "motions.csv").unlink()
        _, done = stages(copied, until="track")
        assert done == {"one/track": "motions.csv is gone"}

    def test_another_version_did_it(self, copied):
        record = copied.parent / "results" / "stages.json"
        text = record.read_text()
        start = text.index('"grainmotion": "')
        record.write_text(text[:start] + '"grainmotion": "0.0.9"' + text[text.index(",", start) :])
        copied.write_text(copied.read_text().replace("search = false", "search = false\niterations = 7"))
        _, done = stages(copied, until="track")
        assert done["one/track"] == "it was done by version 0.0.9"


def _touch_known(path):
    """Let stages of this folder use its files."""
    (path.parent / "results" / "one" / "motions.csv").unlink()
    run(read_experiment(path), until="track")


class TestEstimates:
    def test_times_of_the_log_are_used(self, copied):
        shutil.rmtree(copied.parent / "results" / "one")
        planned = planned_run(read_experiment(copied), until="track")
        needs = estimate(planned)
        names = [stage.name for stage in planned.planned]
        times = dict(zip(names, needs.stages, strict=True))
        assert times["one/track"].from_log
        assert times["segment"].seconds == 0
        logged = logged_times(copied.parent / "results" / "run.log", sizes(planned))
        assert needs.seconds == pytest.approx(needs.start + logged["one/track"])

    def test_times_of_another_size_are_not(self, copied):
        log = copied.parent / "results" / "run.log"
        now = sizes(planned_run(read_experiment(copied), until="track"))
        assert "one/track" in logged_times(log, now)
        finer = logged_times(log, {**now, "volume": "56 x 72 x 72 voxels of 0.05 mm"})
        assert finer == {}
        more_views = logged_times(log, {**now, "states.one": "6 views of 28 x 36 pixels"})
        assert {"reconstruct", "two/track"} <= set(more_views)
        assert "one/track" not in more_views

    def test_a_new_state_takes_as_long_as_the_others(self, copied):
        text = copied.read_text()
        new = text[text.index('[[states]]\nname = "one"') : text.index('[[states]]\nname = "two"')]
        copied.write_text(text + new.replace('"one"', '"three"'))
        planned = planned_run(read_experiment(copied), until="track")
        needs = estimate(planned)
        time = needs.stages[[stage.name for stage in planned.planned].index("three/track")]
        logged = logged_times(copied.parent / "results" / "run.log", sizes(planned))
        assert time.seconds == pytest.approx((logged["one/track"] + logged["two/track"]) / 2)
        assert not time.from_log

    def test_the_program_itself_needs_time_and_memory(self, copied):
        shutil.rmtree(copied.parent / "results")
        needs = estimate(planned_run(read_experiment(copied)))
        assert 3 < needs.start < 5
        assert 0.4e9 < needs.memory < 0.5e9  # 0.46 GB were measured of such a sample

    def test_workers_need_memory_beside_the_command(self, copied):
        planned = planned_run(read_experiment(copied))
        assert estimate(planned).memory_of_worker == 0
        needs = estimate(planned, ComputeConfig(workers=2))
        assert 0.4e9 < needs.memory_of_worker < 0.8e9
        scheduler = ComputeConfig("tcp://node:8786")
        assert estimate(planned, scheduler).memory_of_worker >= needs.memory_of_worker
        two = [WorkerLimits("tcp://one", 16, 8e9), WorkerLimits("tcp://two", 16, 8e9)]
        assert estimate(planned, scheduler, two).memory_of_worker == needs.memory_of_worker

    def test_larger_scans_need_more(self, copied):
        shutil.rmtree(copied.parent / "results")
        small = estimate(planned_run(read_experiment(copied)))
        text = (
            copied.read_text()
            .replace("shape = [28, 36, 36]", "shape = [84, 108, 108]")
            .replace("voxel_size = 0.1", "voxel_size = 0.0333")
        )
        copied.write_text(text)
        large = estimate(planned_run(read_experiment(copied)))
        assert large.memory - small.memory > 45 * 84 * 108 * 108
        assert large.disk > small.disk
        assert large.seconds > small.seconds
        assert large.disk_free > 0
