"""Output that nobody reads any more, that has no space, or that is not there."""

import json
import os
import subprocess
import sys

import pytest

PROGRAM = [sys.executable, "-c", "from grainmotion.__main__ import main; main()"]
FULL = "/dev/full"
no_full_device = pytest.mark.skipif(not os.path.exists(FULL), reason="no device that is always full")


def closed_pipe():
    """The end of a pipe that nobody reads."""
    reading, writing = os.pipe()
    os.close(reading)
    return writing


@pytest.mark.parametrize("words", [["--help"], ["version"], ["version", "--json"]])
def test_a_closed_pipe_ends_the_command_silently_as_shells_expect(words):
    pipe = closed_pipe()
    done = subprocess.run([*PROGRAM, *words], stdout=pipe, stderr=subprocess.PIPE, text=True)
    os.close(pipe)
    assert (done.returncode, done.stderr) == (141, "")


@no_full_device
@pytest.mark.parametrize("words", [["--help"], ["version"], ["version", "--json"]])
def test_a_full_disk_is_no_fault_of_the_program(words):
    with open(FULL, "w") as full:
        done = subprocess.run([*PROGRAM, *words], stdout=full, stderr=subprocess.PIPE, text=True)
    assert done.returncode == 2
    assert done.stderr == (
        "error: standard output: cannot be written: no space left on the disk; make room, then go on\n"
    )


def test_messages_do_not_go_to_standard_output_where_standard_error_is_closed():
    shell = ["bash", "-c", '"$0" "$@" 2>&-', *PROGRAM, "rnu", "--json"]
    done = subprocess.run(shell, stdout=subprocess.PIPE, text=True)
    assert done.returncode == 2
    assert json.loads(done.stdout)["error"]["fact"] == "no command 'rnu'"


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "utf-8"])
def test_names_that_the_encoding_of_the_output_lacks(tmp_path, encoding):
    folder = tmp_path / "Körner-粒"  # empty: the error tells its name
    folder.mkdir()
    environment = {**os.environ, "PYTHONIOENCODING": encoding}
    done = subprocess.run([*PROGRAM, "inspect", folder, "--json"], capture_output=True, env=environment)
    assert done.returncode == 2
    assert json.loads(done.stdout.decode(encoding))["error"]["where"] == str(folder)
