"""A run from a volume and labels of other software: OME-Zarr and NIfTI in, labels with gaps kept, OME-Zarr out."""

from __future__ import annotations

import nibabel
import numpy as np
import pandas as pd
import pytest

import grainmotion as gm
from grainmotion.errors import InputError
from grainmotion.io.geometry_csv import write_geometry
from grainmotion.io.tiff import write_tiff
from grainmotion.projection.volumes import project
from tiny_experiment import BALLS, SHIFTS, VOXEL, geometry, sample

NUMBERS = (7, 300, 70_000)
TOML = """
[reference]
volume = "volume.zarr"
labels = "labels.nii.gz"
[track]
search = false
[[states]]
name = "one"
radiographs = "one.tif"
kind = "line-integrals"
geometry = "one.csv"
[output]
rebuild = true
volumes = "ome-zarr"
exports = ["ome-zarr", "spam"]
"""


def ball_labels():
    """Labels with gaps, the largest beyond 16 bits."""
    z, y, x = np.meshgrid(*((np.arange(n) - (n - 1) / 2) * VOXEL for n in (28, 36, 36)), indexing="ij")
    labels = np.zeros(x.shape, np.int32)
    for number, (bx, by, bz, radius) in zip(NUMBERS, BALLS, strict=True):
        labels[(x - bx) ** 2 + (y - by) ** 2 + (z - bz) ** 2 < radius**2] = number
    return labels


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    """The results of a run."""
    folder = tmp_path_factory.mktemp("given")
    gm.write_volume(folder / "volume.zarr", sample())
    nibabel.save(nibabel.Nifti1Image(ball_labels().T, np.diag([VOXEL] * 3 + [1])), folder / "labels.nii.gz")
    views = geometry([0.0, 45.0, 90.0])
    write_geometry(folder / "one.csv", views)
    write_tiff(folder / "one.tif", project(sample(SHIFTS["one"]), views).astype(np.float32))
    (folder / "experiment.toml").write_text(TOML)
    return gm.run(gm.read_experiment(folder / "experiment.toml"))


def test_labels_keep_their_numbers(result):
    motions = result.motions["one"]
    assert tuple(motions.labels) == NUMBERS
    table = pd.read_csv(result.folder / "one" / "motions.csv", comment="#")
    assert tuple(table["label"]) == NUMBERS
    np.testing.assert_allclose(motions.translations, np.tile(SHIFTS["one"], (3, 1)), atol=0.01)


def test_files_of_volumes(result):
    rebuilt = gm.read_volume(result.folder / "one" / "rebuilt.ome.zarr")
    assert (rebuilt.voxel_size, rebuilt.center) == (pytest.approx(VOXEL), (0, 0, 0))
    numbers = gm.read_labels(result.folder / "one" / "rebuilt.ome.zarr::labels/grains")
    assert set(np.unique(numbers)) == {0, *NUMBERS}
    error = np.abs(rebuilt.array - sample(SHIFTS["one"]).array)
    assert error.mean() < 0.02 * rebuilt.array.max()
    for name in ("reference.ome.zarr::labels/grains", "reference_labels.tif"):
        np.testing.assert_array_equal(gm.read_labels(result.folder / name), ball_labels())
    assert gm.read_volume(result.folder / "reference.tif").voxel_size == pytest.approx(VOXEL)


def test_a_second_run_has_nothing_to_do_and_a_lost_file_is_written_again(result):
    experiment = gm.read_experiment(result.folder.parent / "experiment.toml")
    assert gm.run(experiment).done == ()
    (result.folder / "one" / "rebuilt.ome.zarr" / ".zattrs").unlink()
    assert gm.run(experiment).done == ("one/rebuilt",)


def test_an_input_among_the_results_is_not_overwritten(result):
    path = result.folder.parent / "again.toml"
    path.write_text(TOML.replace('volume = "volume.zarr"', 'volume = "results/reference.ome.zarr"'))
    with pytest.raises(InputError, match=r"reference\.ome\.zarr holds an input and would be overwritten"):
        gm.run(gm.read_experiment(path))
