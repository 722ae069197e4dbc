"""Volumes and labels of other software in an experiment: voxel size, shapes, types of labels."""

from __future__ import annotations

import gzip

import nibabel
import numpy as np
import pytest
import tifffile
from experiment_inputs import inputs_of

from grainmotion.diagnosis.voxel_sizes import size_conflict
from grainmotion.errors import InputError
from grainmotion.experiment.given_grid import voxel_findings
from grainmotion.experiment.given_inputs import given_label_findings, read_given_labels, read_given_volume
from grainmotion.io.geometry_csv import write_geometry
from grainmotion.io.tiff import write_tiff
from grainmotion.io.volumes.tiff_writer import write_volume_tiff
from grainmotion.model.finding import Level
from tiny_experiment import BALLS, VOXEL, geometry, sample

TOML = """
[reference]
volume = "volume.tif"
labels = "labels.npy"
[[states]]
name = "one"
radiographs = "one.tif"
kind = "line-integrals"
geometry = "one.csv"
[volume]
"""


def ball_labels(numbers=(1, 2, 3)):
    """A label a ball of the tiny sample."""
    z, y, x = np.meshgrid(*((np.arange(n) - (n - 1) / 2) * VOXEL for n in (28, 36, 36)), indexing="ij")
    labels = np.zeros(x.shape, np.int64)
    for number, (bx, by, bz, radius) in zip(numbers, BALLS, strict=True):
        labels[(x - bx) ** 2 + (y - by) ** 2 + (z - bz) ** 2 < radius**2] = number
    return labels


@pytest.fixture
def folder(tmp_path):
    """A volume with voxel size, labels, and a state."""
    write_volume_tiff(tmp_path / "volume.tif", sample().array.astype(np.float32), VOXEL, center=(0.1, 0.0, -0.2))
    np.save(tmp_path / "labels.npy", ball_labels())
    write_geometry(tmp_path / "one.csv", geometry([0.0, 45.0, 90.0]))
    write_tiff(tmp_path / "one.tif", np.zeros((3, 28, 36), np.float32))
    return tmp_path


class TestVoxelSize:
    def test_the_file_tells_it(self, folder):
        inputs = inputs_of(folder, TOML)
        assert inputs.grid.voxel_size == pytest.approx(VOXEL)
        assert inputs.grid.center == (0.1, 0.0, -0.2)
        volume = read_given_volume(inputs.volume, inputs.grid)
        np.testing.assert_array_equal(volume.array, sample().array.astype(np.float32))

    def test_the_experiment_file_comes_first(self, folder):
        inputs = inputs_of(folder, TOML + "voxel_size = 0.0979\ncenter = [0, 0, 0.5]")
        assert inputs.grid.voxel_size == 0.0979
        assert inputs.grid.center == (0, 0, 0.5)
        (finding,) = voxel_findings(inputs.volume, inputs.grid, "volume.tif")
        assert finding.level is Level.WARNING
        assert (
            "voxels of 0.1 mm by its ImageJ properties, but volume.voxel_size is 0.0979 mm, 1.021 times apart"
            in finding.fact
        )

    def test_a_size_that_cannot_be_is_compared_with_the_file(self, folder):
        with pytest.raises(InputError, match=r"wrong units\?; volume\.tif tells voxels of 0\.1 mm, .* µm and mm"):
            inputs_of(folder, TOML + "voxel_size = 100")

    def test_a_small_difference_is_no_warning(self, folder):
        inputs = inputs_of(folder, TOML + "voxel_size = 0.099")
        assert [f.level for f in voxel_findings(inputs.volume, inputs.grid, "")] == [Level.NOTE]

    @pytest.mark.parametrize(
        ("ratio", "cause"),
        [(1000, "µm and mm"), (1e-3, "µm and mm"), (10, "cm and mm"), (25.4, "inches"), (2, "binned")],
    )
    def test_the_cause_of_a_contradiction(self, ratio, cause):
        assert cause in size_conflict([0.1 * ratio] * 3, 0.1)
        assert size_conflict([0.101] * 3, 0.1) == ""
        assert "no cubes" in size_conflict([0.1, 0.1, 0.2], 0.1)

    def test_voxels_that_are_no_cubes(self, folder):
        array = sample().array.astype(np.float32)
        tifffile.imwrite(
            folder / "volume.tif",
            array,
            imagej=True,
            resolution=(10, 10),
            metadata={"axes": "ZYX", "unit": "mm", "spacing": 0.2},
        )
        with pytest.raises(InputError, match=r"volume\.tif \(reference\.volume\): .* 0\.1 x 0\.1 x 0\.2 mm .* cubes"):
            inputs_of(folder, TOML)
        inputs = inputs_of(folder, TOML + "voxel_size = 0.1")
        assert "no cubes" in voxel_findings(inputs.volume, inputs.grid, "")[0].fact

    def test_a_slice_that_is_missing_is_named(self, folder):
        (folder / "slices").mkdir()
        for k, page in enumerate(sample().array.astype(np.float32)):
            tifffile.imwrite(folder / "slices" / f"slice_{k + (k > 11):03d}.tif", page)
        inputs = inputs_of(folder, TOML.replace("volume.tif", "slices") + "voxel_size = 0.1")
        (finding,) = voxel_findings(inputs.volume, inputs.grid, "slices")
        assert "gap: slice_012.tif is not there" in finding.fact
        assert "lie too low" in finding.remedy

    def test_nobody_tells_it(self, folder):
        tifffile.imwrite(folder / "volume.tif", sample().array.astype(np.float32), imagej=True, resolution=(10, 10))
        with pytest.raises(InputError, match=r"volume\.voxel_size: it is missing, and volume\.tif tells none"):
            inputs_of(folder, TOML)

    def test_labels_of_another_resolution(self, folder):
        write_volume_tiff(folder / "labels.tif", ball_labels(), 2 * VOXEL)
        inputs = inputs_of(folder, TOML.replace("labels.npy", "labels.tif"))
        volume = read_given_volume(inputs.volume, inputs.grid)
        found = given_label_findings(inputs, volume, read_given_labels(inputs.labels))
        assert "2 times apart: probably a volume binned by 2" in found[0].fact


class TestShapes:
    @pytest.mark.parametrize(
        ("change", "hint"),
        [
            (lambda a: a.transpose(2, 1, 0), "as x y z"),
            (lambda a: a[::2, ::2, ::2], "binned by 2"),
            (lambda a: a.repeat(2, 0).repeat(2, 1).repeat(2, 2), "the volume was binned by 2"),
            (lambda a: a[1:-1, 2:, :], r"cropped by \(2, 2, 0\)"),
            (lambda a: np.pad(a, 3), r"padded by \(6, 6, 6\)"),
            (lambda a: a[:9], "19 slices are missing"),
        ],
    )
    def test_the_cause_is_named(self, folder, change, hint):
        np.save(folder / "labels.npy", change(ball_labels()))
        with pytest.raises(InputError, match=rf"labels\.npy \(reference\.labels\): .*{hint}"):
            inputs_of(folder, TOML)


class TestLabels:
    @pytest.mark.parametrize("dtype", ["u1", "i1", "u2", "i2", ">i2", "u4", "i4", "u8", "i8", "f4", "f8"])
    def test_any_type_with_gaps(self, folder, dtype):
        numbers = (3, 90, 127)
        np.save(folder / "labels.npy", ball_labels(numbers).astype(dtype))
        given = read_given_labels(inputs_of(folder, TOML).labels)
        assert given.array.dtype == np.int32
        np.testing.assert_array_equal(given.array, ball_labels(numbers))

    def test_a_negative_number_for_no_grain(self, folder):
        labels = ball_labels()
        np.save(folder / "labels.npy", np.where(labels == 0, -1, labels))
        inputs = inputs_of(folder, TOML)
        given = read_given_labels(inputs.labels)
        np.testing.assert_array_equal(given.array, labels)
        found = given_label_findings(inputs, read_given_volume(inputs.volume, inputs.grid), given)
        assert [f.fact for f in found] == ["voxels of -1 are taken for no grain"]

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            (lambda a: np.where(a == 2, -1, np.where(a == 3, -2, a)), "ran over the top of int64"),
            (lambda a: a * 2**31, "a label of 6442450944"),
            (lambda a: a.astype("u8") * 2**62, "a label of"),
            (lambda a: a * 1e7, "a label of 30000000"),
            (lambda a: a * 0.5, "not whole numbers"),
            (lambda a: np.where(a == 1, np.nan, a), "not whole numbers"),
            (lambda a: a * 0, "no grains found"),
        ],
    )
    def test_numbers_that_are_no_labels(self, folder, change, message):
        np.save(folder / "labels.npy", change(ball_labels()))
        inputs = inputs_of(folder, TOML)
        with pytest.raises(InputError, match=rf"labels\.npy \(reference\.labels\): .*{message}"):
            read_given_labels(inputs.labels)

    @pytest.mark.parametrize("key", ["volume", "labels"])
    def test_a_truncated_file_is_named_with_its_key(self, folder, key):
        array = sample().array.astype("f4") if key == "volume" else ball_labels().astype("i4")
        data = gzip.compress(nibabel.Nifti1Image(array.T, np.diag([VOXEL] * 3 + [1])).to_bytes())
        (folder / "a.nii.gz").write_bytes(data[: len(data) // 2])
        given = {"volume": "volume.tif", "labels": "labels.npy"}[key]
        inputs = inputs_of(folder, TOML.replace(given, "a.nii.gz") + "voxel_size = 0.1")
        read = {
            "volume": lambda: read_given_volume(inputs.volume, inputs.grid),
            "labels": lambda: read_given_labels(inputs.labels),
        }
        with pytest.raises(InputError, match=rf"a\.nii\.gz \(reference\.{key}\): truncated or damaged gzip"):
            read[key]()

    def test_a_volume_in_place_of_labels(self, folder):
        inputs = inputs_of(folder, TOML.replace("labels.npy", "volume.tif"))
        with pytest.raises(InputError, match="grey values"):
            read_given_labels(inputs.labels)
