"""The program itself: version, help, mistyped names, paths instead of commands, what is no experiment file."""

import json
import shutil

import pytest
from typer.testing import CliRunner

from grainmotion import __version__
from grainmotion.cli.app import app
from grainmotion.cli.exit_codes import EXIT_CODES
from tiny_experiment import write_tiny


def invoke(*arguments, code=0):
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exit_code == code, result.output
    assert "Traceback" not in result.output
    return result


@pytest.fixture(scope="module")
def measurements(tmp_path_factory):
    return write_tiny(tmp_path_factory.mktemp("measurements")).parent


class TestHelp:
    @pytest.mark.parametrize("option", ["--version", "-V"])
    def test_version(self, option):
        assert invoke(option).stdout == f"grainmotion {__version__}\n"

    def test_versions_of_libraries(self):
        assert "numba " in invoke("version", "--verbose").stdout

    @pytest.mark.parametrize("option", ["--help", "-h"])
    def test_commands_stand_in_panels_in_the_order_of_their_use(self, option):
        text = invoke(option).stdout
        panels = ("Start here", "The main job", "Its stages", "Look at results", "Before beam time", "About the")
        assert sorted(panels, key=text.index) == list(panels)
        assert "grainmotion init measurements" in text
        for code in EXIT_CODES:
            assert f" {code} " in text

    def test_options_stand_in_panels(self):
        text = invoke("run", "-h").stdout
        assert all(f"─ {panel} ─" in text for panel in ("Options", "Computing", "Checks", "Output"))

    def test_flags_take_no_value(self):
        assert not [line for line in invoke("run", "-h").stdout.splitlines() if "<bool>" in line or "BOOL" in line]
        assert "<bool>" not in invoke("-h").stdout

    def test_many_words_are_not_broken_inside(self):
        text = " ".join(invoke("simulate", "-h").stdout.replace("│", " ").split())
        assert "gain-drift-views, container, missing, broken, near-spherical" in text

    def test_without_a_command_the_help_is_shown(self):
        assert "The main job" in invoke(code=2).output


@pytest.mark.parametrize(
    ("arguments", "hint"),
    [
        (["rnu"], "no command 'rnu'; did you mean 'run'?"),
        (["export", "dems"], "did you mean 'dem'?"),
        (["frobnicate"], "there are demo, inspect"),
        (["run", "--wokers", "2", "x.toml"], "no option '--wokers'; did you mean '--workers'?"),
        (["--quiet", "run", "x.toml"], "put it behind, as in grainmotion"),
        (["demo.toml"], "no file or folder 'demo.toml'"),
        (["run"], "missing argument 'FILE'"),
        (["run", "x.toml", "--color", "alway"], "'alway' is no value of '--color'; did you mean 'always'?"),
        (["run", "x.toml", "--color", "blue"], "it takes auto, always, never"),
        (["simulate", "x", "--case", "plian"], "did you mean 'plain'?"),
        (["run", "x.toml", "--workers", "two"], "wrong value of '--workers'; give a whole number; "),
        (["simulate", "x", "--seed", "-1"], "wrong value of '--seed'; give a whole number, 0 or more"),
        (["export", "x.toml", "--format", "vkt"], "did you mean 'vtk'?"),
        (["export", "dem", "x.toml", "--spacing", "wide"], "wrong value of '--spacing'; give a number; "),
    ],
)
def test_mistakes_are_told_in_one_line_with_what_may_be_meant(arguments, hint):
    (line,) = invoke(*arguments, code=2).stderr.splitlines()
    assert line.startswith("error: ")
    assert hint in line
    assert "--help`" in line


def test_each_of_several_errors_has_its_own_line(measurements, tmp_path):
    text = (measurements / "experiment.toml").read_text()
    wrong = tmp_path / "experiment.toml"
    wrong.write_text(text.replace("voxel_size = 0.1", "voxel_size = -0.1").replace("sweeps = 3", "sweep = 3"))
    first, second = invoke("inspect", wrong, code=2).stderr.splitlines()
    assert first == f"error: {wrong}: reconstruct.sweep: unknown key; did you mean 'sweeps'?"
    assert second.startswith("  also volume.voxel_size: ")


def test_a_file_whose_name_begins_like_an_option(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "-mine.toml").touch()
    assert "write the file's name as './-mine.toml'" in invoke("run", "-mine.toml", code=2).stderr
    assert "did you mean" not in invoke("run", "-d", code=2).stderr


def test_a_dry_run_refuses_what_a_run_would(measurements):
    error = invoke("run", measurements / "experiment.toml", "--dry-run", "--workers", "0", code=2).stderr
    assert error.startswith("error: --workers: must be at least 1")


def test_wrong_use_is_told_as_json_too():
    document = json.loads(invoke("run", "a.toml", "--json", "--frob", code=2).stdout)
    assert (document["exit_code"], document["error"]["kind"], document["result"]) == (2, "usage", None)


class TestPathInsteadOfACommand:
    def test_a_folder_is_inspected_and_init_suggested(self, measurements, tmp_path):
        folder = shutil.copytree(measurements, tmp_path / "my scans")
        (folder / "experiment.toml").unlink()
        assert invoke(folder).stdout.splitlines()[-1] == f"next: grainmotion init '{folder}'"

    def test_a_folder_with_an_experiment_file(self, measurements):
        last = invoke(measurements).stdout.splitlines()[-1]
        assert last == f"next: grainmotion inspect {measurements / 'experiment.toml'}"

    def test_an_image(self, measurements):
        text = invoke(measurements / "one.tif").stdout
        assert "next: grainmotion inspect" in text


class TestNoExperimentFile:
    @pytest.mark.parametrize("command", ["run", "watch", "track", "plan"])
    def test_a_folder_names_the_file_in_it(self, measurements, command):
        error = invoke(command, measurements, code=2).stderr
        assert f"grainmotion {command} {measurements / 'experiment.toml'}" in error

    def test_a_folder_of_measurements_suggests_init(self, tmp_path):
        error = invoke("run", tmp_path, code=2).stderr
        assert f"grainmotion init {tmp_path}, then grainmotion run {tmp_path / 'experiment.toml'}" in error

    def test_images_suggest_init(self, measurements, tmp_path):
        shutil.copy(measurements / "one.tif", tmp_path)
        error = invoke("run", tmp_path / "one.tif", code=2).stderr
        assert "images or another file of data" in error
        assert f"grainmotion init {tmp_path}" in error

    def test_images_in_a_folder_of_their_own_name_the_experiment_above(self, measurements, monkeypatch):
        image = next((measurements / "reference").iterdir())
        here = f"did you mean grainmotion run {measurements / 'experiment.toml'}?"
        assert here in invoke("run", image, code=2).stderr
        monkeypatch.chdir(image.parent)
        assert here in invoke("run", image.name, code=2).stderr

    def test_a_folder_beside_an_experiment_file_names_that_file(self, measurements, monkeypatch):
        folder = measurements / "reference"
        here = f"did you mean grainmotion run {measurements / 'experiment.toml'}?"
        assert here in invoke("run", folder, code=2).stderr
        monkeypatch.chdir(folder)
        assert here in invoke("run", ".", code=2).stderr

    def test_the_folder_above_is_not_taken_for_this_one(self, measurements, tmp_path, monkeypatch):
        inner = tmp_path / "a" / "b"
        inner.mkdir(parents=True)
        shutil.copy(measurements / "experiment.toml", inner)
        monkeypatch.chdir(inner)
        assert "grainmotion init .., then" in invoke("run", "..", code=2).stderr

    def test_a_folder_with_two_files(self, measurements, tmp_path):
        for name in ("a.toml", "b.toml"):
            shutil.copy(measurements / "experiment.toml", tmp_path / name)
        assert (
            f"one of the 2 files in it: grainmotion run {tmp_path / 'a.toml'}" in invoke("run", tmp_path, code=2).stderr
        )
        lines = invoke("inspect", tmp_path).stdout.splitlines()
        assert lines[-2:] == [f"next: grainmotion inspect {tmp_path / name}" for name in ("a.toml", "b.toml")]

    def test_another_toml(self, tmp_path):
        (tmp_path / "pyproject.toml").write_text("[project]\n")
        assert "none of the tables of an experiment file" in invoke("run", tmp_path / "pyproject.toml", code=2).stderr

    def test_a_mistyped_name(self, measurements):
        error = invoke("run", measurements / "experimet.toml", code=2).stderr
        assert f"did you mean grainmotion run {measurements / 'experiment.toml'}?" in error

    def test_a_missing_folder(self, tmp_path):
        assert "check the path" in invoke("run", tmp_path / "no" / "x.toml", code=2).stderr
