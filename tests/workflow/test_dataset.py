"""Simulated experiments beside files of the user, and simulations that were interrupted."""

import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.io.tiff import write_tiff
from grainmotion.model.geometry import Geometry
from grainmotion.model.volume import Volume
from grainmotion.simulate.detector import Recording
from grainmotion.workflow import dataset
from grainmotion.workflow.dataset import check_new_dataset, write_dataset


def write(folder):
    geometry = Geometry.cone((0.0, 90.0), (4, 5), 0.2, source_to_axis=50, source_to_detector=100)
    images = np.full((2, 4, 5), 1000, dtype=np.float32)
    recording = Recording(images, images, images, geometry)
    return write_dataset(folder, recording, {}, Volume.zeros((4, 4, 4), 0.1))


@pytest.mark.parametrize("name", ["experiment.toml", "reference.csv", "flats/0.tif", "reference/first.tif"])
def test_no_file_of_the_user_is_replaced(tmp_path, name):
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_text("mine")
    with pytest.raises(InputError, match="no file of yours"):
        write(tmp_path)
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == [tmp_path / name]
    assert (tmp_path / name).read_text() == "mine"


def test_other_files_and_empty_folders_may_be_there(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "flats").mkdir()
    assert write(tmp_path).is_file()
    assert len(list((tmp_path / "flats").iterdir())) == 2
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_an_interrupted_simulation_leaves_nothing_in_the_way(tmp_path, monkeypatch):
    written = []

    def interrupted(path, image):
        if len(written) == 3:
            raise KeyboardInterrupt
        written.append(path)
        write_tiff(path, image)

    monkeypatch.setattr(dataset, "write_tiff", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write(tmp_path / "new")
    assert list((tmp_path / "new").iterdir()) == []
    monkeypatch.undo()
    assert write(tmp_path / "new").is_file()


def test_a_folder_that_cannot_be_made_is_told_before_the_simulation(tmp_path):
    (tmp_path / "file").write_text("mine")
    with pytest.raises(InputError, match="is a file"):
        check_new_dataset(tmp_path / "file" / "new")
