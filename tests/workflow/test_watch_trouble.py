"""Watch beside a scanner: files moved away, full disks, two processes, folders that are no states, other versions."""

import errno
import json
import shutil

import pytest

from grainmotion.cli.summary import print_states
from grainmotion.cli.terminal import Terminal
from grainmotion.errors import InputError, WriteError
from grainmotion.experiment.config import read_experiment
from grainmotion.io.geometry_csv import write_geometry
from grainmotion.io.tiff import write_tiff
from grainmotion.model.finding import Level
from grainmotion.workflow import watch_outputs
from grainmotion.workflow.folder_lock import LOCK_FILE
from grainmotion.workflow.run import run
from grainmotion.workflow.watch import WatchSettings, watch
from tiny_experiment import TOML, counts, geometry, sample, write_tiny

QUICK = TOML.replace("search = false", "search = false\niterations = 3")
FOLDERS = QUICK[: QUICK.index("[[states]]")] + '[watch]\nfolders = "steps/*"\ngeometry = "views.csv"\n'
VIEWS = [0.0, 45.0, 90.0]


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    """The experiment with its reference done; no state has arrived."""
    folder = tmp_path_factory.mktemp("prepared") / "tiny"
    path = write_tiny(folder, FOLDERS)
    write_geometry(folder / "views.csv", geometry(VIEWS))
    run(read_experiment(path), until="segment")
    return folder


@pytest.fixture
def folder(prepared, tmp_path):
    """A copy that a test may change."""
    return shutil.copytree(prepared, tmp_path / "tiny")


def arrive(folder, name, x):
    """A folder of a state, one file a view, moved by x mm."""
    for k, image in enumerate(counts(sample((x, 0, 0)), geometry(VIEWS))):
        write_tiff(folder / "steps" / name / f"{k}.tif", image)


def nothing():
    pass


def watched(folder, *steps, **settings):
    """A watch that does a step at each look; its result, and the lines that it said."""
    left, lines = list(steps), list[str]()

    def look(message, done, total):
        if message == "waiting for radiographs" and left:
            left.pop(0)()

    experiment = read_experiment(folder / "experiment.toml")
    result = watch(experiment, settings=WatchSettings(0.02, **settings), progress=look, say=lines.append)
    assert not left
    return result, lines


def test_files_that_are_moved_away_one_by_one_leave_the_results(folder):
    """As to an archive: the state keeps its motions, and those that start from it are not tracked again."""

    def away(name):
        (folder / "steps" / "s1" / name).unlink()

    steps = [lambda: arrive(folder, "s1", 0.05), lambda: arrive(folder, "s2", 0.1), *[nothing] * 6]
    for name in ("1.tif", "0.tif", "2.tif"):
        steps += [lambda name=name: away(name), *[nothing] * 3]
    result, lines = watched(folder, *steps, lambda: arrive(folder, "s3", 0.15), until=3)
    assert list(result.motions) == ["s1", "s2", "s3"]
    assert [line.split(":")[0] for line in lines if line.startswith("s")] == ["s1", "s2", "s3"]
    assert len(result.motions["s3"].fit.start_residuals) == 2


def test_a_radiograph_that_is_taken_again_is_used(folder):
    """It is deleted first, and another one comes some looks later."""
    images = counts(sample((0.2, 0, 0)), geometry(VIEWS))
    path = folder / "steps" / "s1" / "1.tif"

    def again():
        for k, image in enumerate(images):
            write_tiff(path.with_name(f"{k}.tif"), image)

    steps = [lambda: arrive(folder, "s1", 0.05), *[nothing] * 6, path.unlink, *[nothing] * 4, again, *[nothing] * 6]
    result, lines = watched(folder, *steps, stop_after=0.6)
    assert result.motions["s1"].translations[:, 0].mean() == pytest.approx(0.2, abs=0.02)
    assert len([line for line in lines if line.startswith("s1:")]) == 2


def test_another_process_in_the_folder_is_refused(folder):
    """A run, or a second watch, would take half-done stages for its own."""
    refused = []

    def second():
        for call in (run, watch):
            with pytest.raises(InputError, match=r"another run or watch .* wait until it ends, or choose another") as e:
                call(read_experiment(folder / "experiment.toml"))
            refused.append(e)

    result, _ = watched(folder, lambda: arrive(folder, "s1", 0.05), second, until=1)
    assert list(result.motions) == ["s1"]
    assert len(refused) == 2
    assert not (folder / "results" / LOCK_FILE).exists()
    assert run(read_experiment(folder / "experiment.toml")).done == ()


def test_folders_that_cannot_be_states_are_left_out_of_a_run_and_of_a_second_watch(folder):
    for name in ("s1", "_raw", "S1", "report.html"):
        arrive(folder, name, 0.05)
    experiment = read_experiment(folder / "experiment.toml")
    assert [state.name for state in experiment.tables.states] == ["S1"]
    result, _ = watched(folder, until=1)
    assert list(result.motions) == ["S1"]
    findings = run(experiment).findings
    told = [str(f) for f in findings if f.level == Level.WARNING and f.where == "watch.folders"]
    assert len(told) == 3
    assert all(any(f"/{name} " in sentence for sentence in told) for name in ("s1", "_raw", "report.html"))
    assert not any("Value error" in sentence for sentence in told)


def test_outputs_that_a_full_disk_refused_are_written_later(folder, monkeypatch):
    """The page says so until they are there; the watch ends though the disk was full at first."""
    original, calls, pages = watch_outputs.write_state_outputs, [], []

    def full_at_first(*arguments):
        calls.append(arguments)
        if len(calls) < 3:
            raise OSError(errno.ENOSPC, "No space left on device")
        original(*arguments)

    monkeypatch.setattr(watch_outputs, "write_state_outputs", full_at_first)
    monkeypatch.setattr("grainmotion.workflow.watch_session.RETRY_SECONDS", 0.0)
    page = folder / "results" / "watch.html"
    steps = [lambda: arrive(folder, "s1", 0.05), nothing, nothing, lambda: pages.append(page.read_text())]
    result, lines = watched(folder, *steps, stop_after=2.0)
    assert (folder / "results" / "s1" / "residuals.tif").exists()
    assert [line for line in lines if "No space left" in line] == [
        "s1: not all outputs were written: [Errno 28] No space left on device"
    ]
    assert "No space left" in pages[0]
    assert "No space left" not in page.read_text()
    assert result.ended.startswith("no file changed for")


def test_a_drive_that_stays_away_does_not_keep_the_watch_from_ending(folder, monkeypatch):
    def away(*arguments):
        raise OSError(errno.ESTALE, "Stale file handle")

    monkeypatch.setattr("grainmotion.workflow.watch_session.complete_state", away)
    monkeypatch.setattr("grainmotion.workflow.watched_states.RETRY_SECONDS", 0.0)
    result, _ = watched(folder, lambda: arrive(folder, "s1", 0.05), *[nothing] * 3, stop_after=1.0)
    assert result.ended.startswith("no file changed for")
    assert "tried again after a while" in result.page.read_text()


def test_motions_that_could_not_be_written_are_tracked_again(folder, monkeypatch):
    """The folder of the state cannot be made at first; no file of it changes."""
    original, calls = watch_outputs.RunContext.complete, []

    def full_at_first(context, stage):
        calls.append(stage.name)
        if stage.name == "s1/track" and calls.count("s1/track") < 3:
            raise WriteError("motions.h5", "cannot be written", "make room")
        return original(context, stage)

    monkeypatch.setattr(watch_outputs.RunContext, "complete", full_at_first)
    monkeypatch.setattr("grainmotion.workflow.watched_states.RETRY_SECONDS", 0.0)
    result, lines = watched(folder, lambda: arrive(folder, "s1", 0.05), until=1)
    assert list(result.motions) == ["s1"]
    assert lines[1] == "s1: motions.h5: cannot be written; make room; tried again after a while"


def test_a_watch_describes_its_results(folder):
    watched(folder, lambda: arrive(folder, "s1", 0.05), until=1)
    described = json.loads((folder / "results" / "datapackage.json").read_text())
    assert {"series.csv", "s1/motions.csv"} <= {resource["path"] for resource in described["resources"]}


def test_results_of_another_version_are_told_and_made_again(folder):
    arrive(folder, "s1", 0.05)
    stages = folder / "results" / "stages.json"
    stages.write_text(json.dumps({**json.loads(stages.read_text()), "grainmotion": "0.0.9"}))
    findings = run(read_experiment(folder / "experiment.toml"), until="track").findings
    told = next(finding for finding in findings if finding.check == "version")
    assert "of version 0.0.9" in told.fact
    assert "--out" in told.remedy
    again = run(read_experiment(folder / "experiment.toml"), until="track")
    assert not [finding for finding in again.findings if finding.check == "version"]


def test_brackets_in_the_name_of_a_state_are_no_markup(folder, capsys):
    arrive(folder, "s1 [a]", 0.05)
    print_states(Terminal(), run(read_experiment(folder / "experiment.toml"), until="track").motions)
    assert "s1 [a]" in capsys.readouterr().out.splitlines()[3]
