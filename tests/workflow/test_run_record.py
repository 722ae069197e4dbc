"""What the report tells of the run: a command that a shell takes, settings that make the same experiment."""

import shlex
import tomllib

from grainmotion.experiment.config import ExperimentFile, read_experiment
from grainmotion.experiment.inputs import find_inputs
from grainmotion.workflow.run_record import reproducing_command, run_record
from tiny_experiment import write_tiny


def test_command_names_the_file_and_what_differs_from_it(tmp_path):
    folder = tmp_path / "my data"
    folder.mkdir()
    experiment = read_experiment(write_tiny(folder))
    plain = ["grainmotion", "run", str(experiment.path)]
    assert shlex.split(reproducing_command(experiment, experiment.output)) == plain
    other = experiment.on("cpu").checked(force=True, try_fixes=True)
    expected = [*plain, "--out", str(tmp_path / "out"), "--device", "cpu", "--force", "--try-fixes"]
    assert shlex.split(reproducing_command(other, tmp_path / "out")) == expected
    experiment.path.unlink()
    assert shlex.split(reproducing_command(experiment, experiment.output)) == plain


def test_settings_and_inputs_are_those_of_the_run(tmp_path):
    experiment = read_experiment(write_tiny(tmp_path))
    record = run_record(experiment, find_inputs(experiment), experiment.output)
    assert ExperimentFile.model_validate(tomllib.loads(record.settings)) == experiment.tables
    assert ("reference.radiographs", "reference/*.tif, 40 files") in record.inputs
    assert record.folder == str(experiment.output)
    assert "cores" in record.machine
    assert {"grainmotion", "Python", "numba", "edt"} <= set(dict(record.versions))
