"""Completion in a real shell: commands, options, words, experiment files."""

import os
import shutil
import subprocess
import sys

import pytest

from grainmotion.cli.completion import complete_experiment

PROGRAM = f"{sys.executable} -m grainmotion"
ASK = """
grainmotion() {{ {program} "$@"; }}
eval "$(_GRAINMOTION_COMPLETE=source_bash grainmotion)"
COMP_WORDS=({words}); COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1))
env() {{ command env "${{@:1:$#-1}}" {program}; }}
_grainmotion_completion grainmotion
printf '%s\\n' "${{COMPREPLY[@]}}"
"""


def offered(words, folder):
    """What bash offers after Tab, with the script that the program installs."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    script = ASK.format(program=PROGRAM, words=words)
    done = subprocess.run(
        ["bash", "--norc", "-c", script], cwd=folder, env=environment, capture_output=True, text=True, check=True
    )
    assert done.stderr == ""
    return done.stdout.split()


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash")
def test_bash_completes_commands_options_words_and_experiment_files(tmp_path):
    (tmp_path / "experiment.toml").touch()
    (tmp_path / "scan.tif").touch()
    assert offered("grainmotion re", tmp_path) == ["reconstruct", "report"]
    assert offered("grainmotion run --dr", tmp_path) == ["--dry-run"]
    assert offered("grainmotion run ''", tmp_path) == ["experiment.toml"]


class TestExperimentFiles:
    def test_those_that_begin_as_typed(self, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        (tmp_path / "data").mkdir()
        for name in ("a.toml", "b.toml", "pyproject.toml", "data/c.toml", "scan.tif", ".hidden.toml"):
            (tmp_path / name).touch()
        assert complete_experiment("") == ["a.toml", "b.toml"]
        assert complete_experiment("b") == ["b.toml"]
        assert complete_experiment("data/") == ["data/c.toml"]

    def test_names_with_spaces_and_missing_folders_are_left_to_the_shell(self, tmp_path):
        (tmp_path / "my experiment.toml").touch()
        assert complete_experiment(f"{tmp_path}/") == []
        assert complete_experiment(f"{tmp_path}/no/") == []
