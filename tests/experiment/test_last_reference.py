"""What the reference of an earlier run holds (`experiment.last_reference`)."""

import numpy as np

from grainmotion.experiment.last_reference import described, last_reference
from grainmotion.io.results import StoredReference
from grainmotion.model.volume import Volume


def test_no_file_no_sentence(tmp_path):
    assert last_reference(tmp_path / "reference.h5") == ()


def test_a_damaged_file_is_named(tmp_path):
    path = tmp_path / "reference.h5"
    path.write_bytes(b"\x89HDF\r\n\x1a\n cut short")
    (sentence,) = last_reference(path)
    assert "reference.h5" in sentence


def test_silent_before_the_segmentation():
    assert described(StoredReference(Volume(np.zeros((4, 4, 4), np.float32), 0.1))) == ()
