"""Too little memory: it is told at once, and large arrays are kept in files with the same results."""

from __future__ import annotations

import logging
import os

import numpy as np
import pytest

from grainmotion.cluster.connection import LOCAL, ComputeConfig
from grainmotion.errors import InputError
from grainmotion.experiment.config import read_experiment
from grainmotion.experiment.inputs import find_inputs
from grainmotion.model import large_arrays
from grainmotion.workflow import memory
from grainmotion.workflow.run import run
from tiny_experiment import write_tiny


def test_free_memory_is_between_none_and_all():
    assert 0 < memory.free_memory() < 1e14


def test_memory_is_given_back_where_the_system_takes_it():
    memory.give_back_memory()


def test_a_container_limits_it(tmp_path, monkeypatch):
    monkeypatch.setattr(memory, "_GROUP", tmp_path)
    (tmp_path / "memory.max").write_text("3000\n")
    (tmp_path / "memory.current").write_text("2000\n")
    assert memory.free_memory() == 1000
    (tmp_path / "memory.stat").write_text("anon 5\ninactive_file 500\n")
    assert memory.free_memory() == 1500
    (tmp_path / "memory.max").write_text("max\n")
    assert memory.free_memory() > 1e6


@pytest.mark.parametrize(("told", "size"), [("8GB", 8e9), ("1.5 GiB", 1.5 * 2**30), ("500m", 5e8), ("70", 70)])
def test_sizes_as_people_write_them(told, size):
    assert ComputeConfig(memory=told).bytes == size


@pytest.mark.parametrize("told", ["", "much", "GB", "-1GB", "8 apples"])
def test_a_size_that_is_none_is_refused(told):
    with pytest.raises(InputError, match="no size") as error:
        ComputeConfig(memory=told)
    assert error.value.remedy == "give a number and a unit, as 8GB"


def test_a_run_with_too_little_memory_says_so_and_gives_the_same(tmp_path, monkeypatch, caplog):
    monkeypatch.setattr(large_arrays, "MAX_SMALL_ARRAY", 1000)
    experiment = read_experiment(write_tiny(tmp_path))
    usual = run(experiment, out=tmp_path / "usual", until="track")
    made = []
    monkeypatch.setattr(memory, "ArrayFiles", lambda folder: made.append(folder) or Counted(folder))
    Counted.bytes = 0
    with caplog.at_level(logging.WARNING, "grainmotion"):
        short = run(experiment, out=tmp_path / "short", until="track", workplace=ComputeConfig(memory="1MB"))
    volume, labels = usual.volume.array, usual.labels
    assert made == [tmp_path]
    assert Counted.bytes > 8 * volume.size
    assert "the run needs about" in caplog.text
    assert "0.001 GB may be used" in caplog.text
    assert (short.volume.array == volume).all()
    assert (short.labels == labels).all()
    for name, motions in usual.motions.items():
        assert np.array_equal(motions.translations, short.motions[name].translations)
        assert np.array_equal(motions.rotations, short.motions[name].rotations)
    assert not [name for name in os.listdir(tmp_path / "short") if name.startswith("tmp")]


class Counted:
    """Files of arrays that count their bytes."""

    bytes = 0

    def __init__(self, folder):
        from grainmotion.io.array_files import ArrayFiles

        self.make = ArrayFiles(folder)

    def __call__(self, shape, dtype):
        array = self.make(shape, dtype)
        Counted.bytes += array.nbytes
        return array


def test_enough_memory_is_no_matter(tmp_path, caplog):
    inputs = find_inputs(read_experiment(write_tiny(tmp_path)))
    with caplog.at_level(logging.WARNING, "grainmotion"), memory.memory_of_run(inputs, tmp_path, LOCAL):
        assert large_arrays._storage.get() is None
    assert caplog.text == ""


def test_workers_have_memory_of_their_own(tmp_path):
    inputs = find_inputs(read_experiment(write_tiny(tmp_path)))
    with memory.memory_of_run(inputs, tmp_path, ComputeConfig(workers=2, memory="1MB")):
        assert large_arrays._storage.get() is None
