"""The reference of a run (`workflow.reference_stages`): when its volume is in memory."""

import numpy as np
import pytest

from grainmotion.io.results import StoredReference, write_reference
from grainmotion.model.progress import listening
from grainmotion.model.volume import Volume
from grainmotion.segmentation.settings import SegmentSettings
from grainmotion.workflow import reference_stages
from grainmotion.workflow.reference_stages import SegmentedReference


@pytest.fixture
def file(tmp_path):
    """A stored reference of two grains."""
    labels = np.zeros((16, 16, 30), np.int32)
    labels[4:12, 4:12, 4:12], labels[4:12, 4:12, 16:24] = 1, 2
    write_reference(tmp_path / "reference.h5", StoredReference(Volume((labels > 0) * 0.5, 0.1), (), labels))
    return tmp_path / "reference.h5"


@pytest.mark.parametrize("largest", [0, 1 << 26])
@pytest.mark.parametrize("read_before", [False, True])
def test_a_large_volume_leaves_the_memory_while_grains_are_tracked(file, monkeypatch, largest, read_before):
    """Also in a run that goes on from the file of an earlier one."""
    monkeypatch.setattr(reference_stages, "MAX_KEPT_VOLUME", largest)
    reference = SegmentedReference(file, SegmentSettings())
    if read_before:
        assert reference.stored.labels.max() == 2
    assert len(reference.released().grains) == 2
    assert ("stored" in vars(reference)) == (largest > 0)
    assert reference.stored.volume.array.max() == 0.5


def test_reading_and_cutting_are_told(file):
    """Where a run goes on from stored results they may be the longest of what it does first."""
    told = []
    with listening(lambda message, done, total: told.append(message)):
        assert len(SegmentedReference(file, SegmentSettings()).grains) == 2
    steps = list(dict.fromkeys(message.split(" (")[0] for message in told))
    assert steps == ["segment: reading the volume and its labels", "segment: cutting the grains"]
