"""VTK files for ParaView, read back with VTK's own readers."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOXML import vtkXMLImageDataReader, vtkXMLPolyDataReader

from grainmotion.errors import InputError
from grainmotion.io.vtk import STATUS_CODES, write_grains_vtp, write_image_vti
from grainmotion.model.motions import Motions
from grainmotion.model.volume import Volume
from grainmotion.rotations import rotation_matrix


def motions(n: int = 5) -> Motions:
    """Five grains, one of each status; the last one has no motion."""
    random = np.random.default_rng(1)
    rotations = random.normal(scale=0.3, size=(n, 3))
    translations = random.normal(size=(n, 3))
    root = random.normal(size=(n, 6, 6)) * 0.01
    covariances = root @ root.swapaxes(1, 2)
    for array in (rotations, translations, covariances):
        array[-1] = np.nan
    return replace(
        Motions.identity(np.arange(n) * 3 + 1, random.normal(size=(n, 3))),
        rotations=rotations,
        translations=translations,
        covariances=covariances,
        residuals=random.random(n),
        iterations=np.arange(n),
        statuses=np.array(list(STATUS_CODES)[:n], dtype="<U20"),
    )


def read(reader, path: Path):
    """The file as VTK reads it; VTK's warnings and errors fail the test."""
    problems = []
    reader.AddObserver("ErrorEvent", lambda *_: problems.append("error"))
    reader.AddObserver("WarningEvent", lambda *_: problems.append("warning"))
    reader.SetFileName(str(path))
    reader.Update()
    assert not problems
    return reader.GetOutput()


class TestGrains:
    def test_every_field_is_read_back(self, tmp_path):
        written = replace(motions(), reasons=("", "tilted by 5° ±2", "", "", ""))
        write_grains_vtp(tmp_path / "grains.vtp", written)
        data = read(vtkXMLPolyDataReader(), tmp_path / "grains.vtp")
        arrays = data.GetPointData()
        texts = {name: arrays.GetAbstractArray(name) for name in ("status", "reason")}
        assert [texts["status"].GetValue(i) for i in range(5)] == list(written.statuses)
        assert [texts["reason"].GetValue(i) for i in range(5)] == ["", "tilted by 5 deg +-2", "", "", ""]
        names = {arrays.GetArrayName(i) for i in range(arrays.GetNumberOfArrays())} - set(texts)
        fields = {name: vtk_to_numpy(arrays.GetArray(name)) for name in names}
        sd = np.sqrt(np.diagonal(written.covariances, axis1=1, axis2=2))
        expected = {
            "label": written.labels,
            "status_code": np.arange(5),
            "ok_translation": written.ok_translation,
            "ok_rotation": written.ok_rotation,
            "reference_center": written.centers,
            "displacement": written.translations,
            "displacement_magnitude": np.sqrt((written.translations**2).sum(axis=1)),
            "rotation_angle_deg": np.rad2deg(np.sqrt((written.rotations**2).sum(axis=1))),
            "uncertainty_displacement": np.sqrt((sd[:, :3] ** 2).sum(axis=1)),
            "uncertainty_rotation_deg": np.rad2deg(np.sqrt((sd[:, 3:] ** 2).sum(axis=1))),
            "rotation_vector_deg": np.rad2deg(written.rotations),
            "sd_displacement": sd[:, :3],
            "sd_rotation_deg": np.rad2deg(sd[:, 3:]),
            "displacement_covariance": written.covariances[:, :3, :3].reshape(-1, 9),
            "residual": written.residuals,
            "iterations": written.iterations,
        }
        assert set(fields) == {*expected, "rotation_matrix"}
        for name, values in expected.items():
            np.testing.assert_allclose(fields[name], values, rtol=1e-14, err_msg=name)
        matrices = fields["rotation_matrix"].reshape(-1, 3, 3)
        np.testing.assert_allclose(matrices[:-1], rotation_matrix(written.rotations[:-1]), atol=1e-15)
        assert np.isnan(matrices[-1]).all()

    def test_points_are_at_the_current_centres(self, tmp_path):
        written = motions()
        write_grains_vtp(tmp_path / "grains.vtp", written)
        data = read(vtkXMLPolyDataReader(), tmp_path / "grains.vtp")
        points = vtk_to_numpy(data.GetPoints().GetData())
        np.testing.assert_array_equal(points[:-1], (written.centers + written.translations)[:-1])
        np.testing.assert_array_equal(points[-1], written.centers[-1])
        assert data.GetNumberOfVerts() == 5

    def test_active_vectors_scalars_and_tensors(self, tmp_path):
        write_grains_vtp(tmp_path / "grains.vtp", motions())
        data = read(vtkXMLPolyDataReader(), tmp_path / "grains.vtp").GetPointData()
        assert data.GetVectors().GetName() == "displacement"
        assert data.GetScalars().GetName() == "status_code"
        assert data.GetTensors().GetName() == "rotation_matrix"

    def test_file_without_grains(self, tmp_path):
        write_grains_vtp(tmp_path / "none.vtp", Motions.identity(np.zeros(0, int), np.zeros((0, 3))))
        assert read(vtkXMLPolyDataReader(), tmp_path / "none.vtp").GetNumberOfPoints() == 0

    def test_folder_that_cannot_be_created_is_refused(self, tmp_path):
        (tmp_path / "file").write_text("in the way")
        with pytest.raises(InputError, match="cannot be written"):
            write_grains_vtp(tmp_path / "file" / "grains.vtp", motions())


class TestImage:
    @pytest.mark.parametrize("shape", [(3, 4, 5), (70, 80, 90)], ids=["one block", "several blocks"])
    def test_voxels_and_labels_are_read_back(self, tmp_path, shape):
        random = np.random.default_rng(2)
        volume = Volume(random.random(shape), 0.25, (1.0, -2.0, 3.5))
        labels = random.integers(0, 9, shape)
        write_image_vti(tmp_path / "volume.vti", volume, labels)
        image = read(vtkXMLImageDataReader(), tmp_path / "volume.vti")
        cells = image.GetCellData()
        np.testing.assert_array_equal(vtk_to_numpy(cells.GetArray("attenuation")).reshape(shape), volume.array)
        np.testing.assert_array_equal(vtk_to_numpy(cells.GetArray("label")).reshape(shape), labels)

    def test_voxels_are_at_the_positions_of_the_volume(self, tmp_path):
        volume = Volume.zeros((3, 4, 5), 0.25, (1.0, -2.0, 3.5))
        write_image_vti(tmp_path / "volume.vti", volume)
        image = read(vtkXMLImageDataReader(), tmp_path / "volume.vti")
        bounds = np.array(image.GetBounds()).reshape(3, 2)
        np.testing.assert_allclose(bounds.mean(axis=1), volume.center)
        np.testing.assert_allclose(np.ptp(bounds, axis=1), np.array([5, 4, 3]) * 0.25)
        cell = image.GetCell(0).GetBounds()
        np.testing.assert_allclose(np.reshape(cell, (3, 2)).mean(axis=1), volume.origin)

    def test_a_large_volume_is_not_copied(self, tmp_path):
        volume, labels = Volume.zeros((60, 300, 400), 0.25), np.zeros((60, 300, 400), np.int32)  # 29 MB each
        tracemalloc.start()
        write_image_vti(tmp_path / "volume.vti", volume, labels)
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert peak < 8e6

    def test_labels_of_another_shape_are_refused(self, tmp_path):
        with pytest.raises(InputError, match="labels"):
            write_image_vti(tmp_path / "v.vti", Volume.zeros((3, 4, 5), 1.0), np.zeros((3, 4, 4), int))
        assert not list(tmp_path.iterdir())


def test_strains_are_tensors_of_the_points(tmp_path):
    strains = np.arange(30.0).reshape(5, 6) / 1000
    strained = replace(motions(), strains=strains, strain_covariances=np.tile(1e-6 * np.eye(6), (5, 1, 1)))
    write_grains_vtp(tmp_path / "grains.vtp", strained)
    data = read(vtkXMLPolyDataReader(), tmp_path / "grains.vtp").GetPointData()
    np.testing.assert_array_equal(vtk_to_numpy(data.GetArray("strain"))[:, [0, 4, 8, 5, 2, 1]], strains)
    np.testing.assert_allclose(vtk_to_numpy(data.GetArray("sd_strain")), 1e-3)
