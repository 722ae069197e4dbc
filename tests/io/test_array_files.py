"""Arrays in mapped files: they behave as arrays, and leave nothing behind."""

from __future__ import annotations

import os

import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.io.array_files import ArrayFiles


def test_an_array_in_a_file_is_an_array_of_zeros_to_write_to(tmp_path):
    array = ArrayFiles(tmp_path)((3, 4, 5), np.float32)
    assert type(array) is np.ndarray
    assert array.shape == (3, 4, 5)
    assert array.dtype == np.float32
    assert not array.any()
    array[1] = 2
    assert array.sum() == 40


def test_its_file_has_no_name(tmp_path):
    array = ArrayFiles(tmp_path)((1000,), np.int32)
    array[:] = 1
    assert os.listdir(tmp_path) == []


def test_a_disk_without_room_is_told_at_once(tmp_path):
    with pytest.raises(InputError, match="no room for a file of 1e\\+06 GB") as error:
        ArrayFiles(tmp_path)((10**15,), np.uint8)
    assert "--out" in error.value.remedy


def test_a_folder_that_is_missing_is_named(tmp_path):
    with pytest.raises(InputError, match="nowhere"):
        ArrayFiles(tmp_path / "nowhere")((10,), np.uint8)
