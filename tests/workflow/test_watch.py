"""Watch: states tracked when their files are complete, as a run would; partial, wrong and late files, and its ends."""

import shutil
import threading
import time

import h5py
import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.experiment.config import read_experiment
from grainmotion.io.geometry_csv import write_geometry
from grainmotion.io.results import read_motions_h5
from grainmotion.io.tiff import read_tiff, write_tiff
from grainmotion.workflow import watch_session as watching
from grainmotion.workflow.run import run
from grainmotion.workflow.watch import WatchSettings, watch
from tiny_experiment import TOML, counts, geometry, sample, write_tiny

QUICK = TOML.replace("search = false", "search = false\niterations = 3")
HEAD = QUICK[: QUICK.index("[[states]]")]
FOLDERS = HEAD + '[watch]\nfolders = "steps/*"\ngeometry = "views.csv"\n'
VIEWS = [0.0, 45.0, 90.0]
FAST = 0.02  # seconds between looks
MAX_LOOKS = 400


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    """The experiment with its reference done, shared by the tests; states have not arrived."""
    folder = tmp_path_factory.mktemp("prepared") / "tiny"
    path = write_tiny(folder, QUICK)
    write_geometry(folder / "views.csv", geometry(VIEWS))
    run(read_experiment(path), until="segment")
    (folder / "later").mkdir()
    for name in ("one.tif", "two.npy"):
        (folder / name).rename(folder / "later" / name)
    return folder


@pytest.fixture
def folder(prepared, tmp_path):
    """A copy that a test may change."""
    return shutil.copytree(prepared, tmp_path / "tiny")


class Looks:
    """Does something at each look of a watch, in order; fails a test whose watch does not end."""

    def __init__(self, *steps):
        self.steps, self.count, self.lines = list(steps), 0, []

    def __call__(self, message, done, total):
        if message != "waiting for radiographs":
            return
        self.count += 1
        assert self.count < MAX_LOOKS, self.lines
        if self.steps:
            self.steps.pop(0)()


def nothing():
    pass


def started(folder, looks, toml=QUICK, **settings):
    (folder / "experiment.toml").write_text(toml)
    experiment = read_experiment(folder / "experiment.toml")
    settings = WatchSettings(FAST, **settings)
    return watch(experiment, settings=settings, progress=looks, say=looks.lines.append)


def arrive(folder, *names):
    for name in names:
        shutil.copy(folder / "later" / name, folder / name)


def radiographs(shift):
    return counts(sample(shift), geometry(VIEWS))


def step(folder, name, shift, views=range(3)):
    """Write a folder of a state, one file a view."""
    images = radiographs(shift)
    for k in views:
        write_tiff(folder / "steps" / name / f"{k}.tif", images[k])


def test_files_written_slowly_by_another_thread(folder):
    """Each file comes in pieces; the results are those of a run, and a run has nothing left to do."""

    def scanner():
        for name in ("one.tif", "two.npy"):
            content = (folder / "later" / name).read_bytes()
            pieces = [content[: len(content) // 3], content[len(content) // 3 : -100], content[-100:]]
            with (folder / name).open("wb") as file:
                for piece in pieces:
                    file.write(piece)
                    file.flush()
                    time.sleep(5 * FAST)

    thread = threading.Thread(target=scanner)
    looks = Looks(thread.start)
    result = started(folder, looks)
    thread.join()
    assert result.ended == "all states of the file are tracked"
    assert list(result.motions) == ["one", "two"]
    again = run(read_experiment(folder / "experiment.toml"))
    assert again.done == ()
    other = run(read_experiment(folder / "experiment.toml"), out=folder / "other")
    for name, motions in other.motions.items():
        np.testing.assert_array_equal(result.motions[name].translations, motions.translations)
        stored = read_motions_h5(folder / "results" / name / "motions.h5")
        np.testing.assert_array_equal(stored.covariances, motions.covariances)
    names = {path.relative_to(folder / "other") for path in (folder / "other").rglob("*")}
    assert {path.relative_to(folder / "results") for path in (folder / "results").rglob("*")} - names == {
        (folder / "results" / "watch.html").relative_to(folder / "results")
    }


@pytest.mark.parametrize(("name", "state"), [("one.tif", "one"), ("two.npy", "two"), ("one.h5", "one")])
def test_a_truncated_file_is_not_used_however_long_it_stays(folder, name, state):
    toml = QUICK
    if name == "one.h5":
        toml = QUICK.replace('"one.tif"', '"one.h5::/images"')
        with h5py.File(folder / "later" / name, "w") as file:
            file["images"] = read_tiff(folder / "later" / "one.tif")
    content, seen = (folder / "later" / name).read_bytes(), []

    def page():
        seen.append((folder / "results" / "watch.html").read_text())
        assert not (folder / "results" / state / "motions.h5").exists()

    looks = Looks(
        lambda: (folder / name).write_bytes(content[:-700]),
        *[nothing] * 6,
        page,
        lambda: (folder / name).write_bytes(content),
    )
    result = started(folder, looks, toml, until=1)
    assert list(result.motions) == [state]
    assert "arriving" in seen[0]
    assert name in seen[0]
    assert "truncated" in seen[0]


def test_a_state_waits_for_as_many_radiographs_as_views(folder):
    seen = []
    looks = Looks(
        lambda: step(folder, "s1", (0.1, 0, 0), [0]),
        lambda: step(folder, "s1", (0.1, 0, 0), [0, 1]),
        *[nothing] * 5,
        lambda: seen.append((folder / "results" / "watch.html").read_text()),
        lambda: step(folder, "s1", (0.1, 0, 0)),
    )
    result = started(folder, looks, FOLDERS, until=1)
    np.testing.assert_allclose(result.motions["s1"].translations, np.tile([0.1, 0, 0], (3, 1)), atol=0.02)
    assert "2 files" in seen[0]
    assert "arriving" in seen[0]
    assert "2 of 3 radiographs are there; wait for the others" in seen[0]


def test_new_folders_become_states_in_the_order_of_their_numbers(folder):
    looks = Looks(
        lambda: (folder / "steps").mkdir(),
        lambda: step(folder, "load-2", (0.05, 0, 0)),
        *[nothing] * 3,
        lambda: step(folder, "load-10", (0.1, 0, 0)),
        *[nothing] * 3,
    )
    result = started(folder, looks, FOLDERS, until=2)
    assert list(result.motions) == ["load-2", "load-10"]
    assert len(result.motions["load-10"].fit.start_residuals) == 2
    again = run(read_experiment(folder / "experiment.toml"))
    assert list(again.motions) == ["load-2", "load-10"]
    assert again.done == ()


def test_a_state_that_comes_late_is_put_in_its_place(folder):
    """The second folder is complete before the first: it is tracked at once, and again from the first one's motions."""
    looks = Looks(
        lambda: [step(folder, "s1", (0.05, 0, 0), [0]), step(folder, "s2", (0.1, 0, 0))],
        *[nothing] * 6,
        lambda: step(folder, "s1", (0.05, 0, 0)),
        *[nothing] * 6,
    )
    result = started(folder, looks, FOLDERS, stop_after=0.6)
    assert [line.split(":")[0] for line in looks.lines if line.startswith("s")] == ["s2", "s1", "s2"]
    assert list(result.motions) == ["s1", "s2"]
    assert run(read_experiment(folder / "experiment.toml")).done == ()


def test_an_error_of_one_state_does_not_end_the_watch(folder):
    """Images of another size, then radiographs upside down, then a sound state; the first is mended at last."""

    def wrong_size():
        for k in range(3):
            write_tiff(folder / "steps" / "s1" / f"{k}.tif", np.full((5, 7), 900, np.uint16))

    def upside_down():
        for k, image in enumerate(radiographs((0.05, 0, 0))[:, ::-1]):
            write_tiff(folder / "steps" / "s2" / f"{k}.tif", image)

    seen = []
    looks = Looks(
        wrong_size,
        upside_down,
        *[nothing] * 6,
        lambda: step(folder, "s3", (0.1, 0, 0)),
        *[nothing] * 6,
        lambda: seen.append((folder / "results" / "watch.html").read_text()),
        lambda: shutil.rmtree(folder / "steps" / "s1"),
        lambda: step(folder, "s1", (0.05, 0, 0)),
    )
    result = started(folder, looks, FOLDERS, until=3)
    assert list(result.motions) == ["s1", "s2", "s3"]
    assert set(result.motions["s2"].statuses) == {"not-fitted"}
    assert result.motions["s3"].usable.all()
    assert "(5, 7)" in seen[0]
    assert "refused" in seen[0]
    assert run(read_experiment(folder / "experiment.toml")).done == ()


def test_a_fault_of_the_program_does_not_end_the_watch(folder, monkeypatch):
    original = watching.track_stage

    def faulty(context, reference, name, tracked):
        if name == "s1":
            raise ZeroDivisionError("of a test")
        return original(context, reference, name, tracked)

    monkeypatch.setattr(watching, "track_stage", faulty)
    looks = Looks(
        lambda: step(folder, "s1", (0.05, 0, 0)),
        *[nothing] * 4,
        lambda: step(folder, "s2", (0.1, 0, 0)),
        *[nothing] * 4,
    )
    result = started(folder, looks, FOLDERS, until=1)
    assert list(result.motions) == ["s2"]
    assert any("fault of the program (ZeroDivisionError: of a test)" in line for line in looks.lines)
    assert "ZeroDivisionError" in (folder / "results" / "run.log").read_text()


def test_a_drive_that_was_away_is_tried_again(folder, monkeypatch):
    original, calls = watching.complete_state, []

    def away_at_first(*arguments):
        calls.append(arguments)
        if len(calls) < 3:
            raise OSError("the network path was not found")
        return original(*arguments)

    monkeypatch.setattr(watching, "complete_state", away_at_first)
    monkeypatch.setattr("grainmotion.workflow.watched_states.RETRY_SECONDS", 0.0)
    result = started(folder, Looks(lambda: step(folder, "s1", (0.05, 0, 0))), FOLDERS, until=1)
    assert list(result.motions) == ["s1"]
    assert len(calls) == 3


def test_a_fault_in_an_output_of_all_states_does_not_end_the_watch(folder, monkeypatch):
    def faulty(*arguments):
        raise ZeroDivisionError("of a test")

    monkeypatch.setattr("grainmotion.workflow.watch_outputs.write_outputs_of_all_states", faulty)
    looks = Looks(lambda: step(folder, "s1", (0.05, 0, 0)), *[nothing] * 5, lambda: step(folder, "s2", (0.1, 0, 0)))
    result = started(folder, looks, FOLDERS, until=2)
    assert list(result.motions) == ["s1", "s2"]
    assert "the table of all states was not written: of a test" in result.page.read_text()


def test_changed_radiographs_are_tracked_again(folder):
    def changed():
        arrive(folder, "one.tif")
        write_tiff(folder / "one.tif", radiographs((0.2, 0, 0)))

    looks = Looks(lambda: arrive(folder, "one.tif"), *[nothing] * 6, changed, *[nothing] * 6)
    result = started(folder, looks, stop_after=0.6)
    np.testing.assert_allclose(result.motions["one"].translations[:, 0], 0.2, atol=0.02)


def test_radiographs_that_are_moved_away_leave_their_results(folder):
    looks = Looks(
        lambda: step(folder, "s1", (0.05, 0, 0)),
        *[nothing] * 5,
        lambda: shutil.rmtree(folder / "steps" / "s1"),
        *[nothing] * 3,
        lambda: step(folder, "s2", (0.1, 0, 0)),
    )
    result = started(folder, looks, FOLDERS, until=2)
    assert list(result.motions) == ["s1", "s2"]
    assert len(result.motions["s2"].fit.start_residuals) == 2
    assert any("the report was not written" in line for line in looks.lines)


def interrupt():
    raise KeyboardInterrupt


def test_an_interrupt_ends_it_with_what_is_done(folder):
    looks = Looks(lambda: arrive(folder, "one.tif"), *[nothing] * 5, interrupt)
    result = started(folder, looks)
    assert (result.interrupted, list(result.motions)) == (True, ["one"])
    page = result.page.read_text()
    assert "ended: interrupted" in page
    assert 'http-equiv="refresh"' not in page
    arrive(folder, "two.npy")
    again = run(read_experiment(folder / "experiment.toml"))
    assert "one/track" in again.reused
    assert "two/track" in again.done


def test_a_second_watch_keeps_what_the_first_did(folder):
    arrive(folder, "one.tif")
    started(folder, Looks(), until=1)
    arrive(folder, "two.npy")
    log = (folder / "results" / "run.log").read_text()
    result = started(folder, Looks())
    assert list(result.motions) == ["one", "two"]
    assert "kept: one/track" in (folder / "results" / "run.log").read_text().removeprefix(log)


def test_a_start_from_a_file_is_waited_for(folder):
    """The radiographs are there first; the motions from which the state starts come from another program."""
    toml = QUICK.replace('name = "one"', 'name = "one"\ninitial = "start.csv"')
    motions, seen = [], []
    looks = Looks(
        lambda: arrive(folder, "two.npy"),
        *[nothing] * 4,
        lambda: motions.append((folder / "results" / "two" / "motions.csv").read_bytes()),
        lambda: arrive(folder, "one.tif"),
        *[nothing] * 5,
        lambda: seen.append((folder / "results" / "watch.html").read_text()),
        lambda: (folder / "start.csv").write_bytes(motions[0]),
    )
    result = started(folder, looks, toml, until=2)
    assert list(result.motions) == ["one", "two"]
    assert "initial: no such file" in seen[0]


def test_it_ends_when_nothing_comes(folder):
    result = started(folder, Looks(), stop_after=0.1)
    assert result.ended == "no file changed for 0.1 s"
    assert result.motions == {}
    assert "waiting" in result.page.read_text()


def test_folders_that_cannot_be_states_are_told_and_left_out(folder):
    looks = Looks(
        lambda: step(folder, "_raw", (0.05, 0, 0)),
        lambda: step(folder, "report.html", (0.05, 0, 0)),
        lambda: step(folder, "<b>s1", (0.1, 0, 0)),
        lambda: step(folder, "s2 & more", (0.1, 0, 0)),
    )
    result = started(folder, looks, FOLDERS, until=1)
    assert list(result.motions) == ["s2 & more"]
    page = result.page.read_text()
    assert "s2 &amp; more" in page
    assert "_raw cannot be a state" in page
    assert "report.html" in page
    assert "<b>" not in page


def test_a_told_number_of_radiographs_is_waited_for(folder):
    looks = Looks(lambda: step(folder, "s1", (0.05, 0, 0)), *[nothing] * 5)
    result = started(folder, looks, FOLDERS + "count = 4\n", stop_after=0.4)
    assert result.motions == {}
    assert "3 of 4 radiographs" in result.page.read_text()


@pytest.mark.parametrize(
    ("toml", "settings", "message"),
    [
        (HEAD, {}, "no state, and no .watch. folders"),
        (FOLDERS + 'folder = "x"\n', {}, "watch.folder: unknown key"),
        (HEAD + '[watch]\nradiographs = "x"\n', {}, "watch.folders: it is missing"),
        (QUICK, {"until": 0}, "--until"),
        (QUICK, {"stop_after": -1.0}, "--stop-after"),
        (QUICK.replace("reference/*.tif", "nowhere/*.tif"), {}, "nowhere"),
    ],
)
def test_what_cannot_be_watched_is_refused(folder, toml, settings, message):
    with pytest.raises(InputError, match=message):
        started(folder, Looks(), toml, **settings)


def test_run_takes_the_folders_that_are_there(folder):
    step(folder, "s10", (0.1, 0, 0))
    step(folder, "s9", (0.05, 0, 0))
    text = FOLDERS + '[[states]]\nname = "first"\nradiographs = "later/one.tif"\ngeometry = "one.csv"\n'
    (folder / "experiment.toml").write_text(text)
    experiment = read_experiment(folder / "experiment.toml")
    assert [state.name for state in experiment.tables.states] == ["first", "s9", "s10"]
    assert list(run(experiment, until="track").motions) == ["first", "s9", "s10"]
