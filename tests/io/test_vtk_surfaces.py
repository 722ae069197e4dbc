"""Grains as surfaces and points in time, read back as ParaView's users in Python do, by pyvista."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import pyvista

from grainmotion.io.vtk import write_grains_vtp, write_pvd, write_surfaces_vtp
from grainmotion.model.motions import Motions
from grainmotion.rotations import rotation_matrix


@dataclass(frozen=True)
class Tetrahedron:
    """Four points, and triangles that face outwards."""

    vertices: np.ndarray
    faces: np.ndarray


def tetrahedron(at: tuple[float, float, float]) -> Tetrahedron:
    """Of unequal edges, so that no rotation or mirror image looks the same."""
    vertices = np.array([[0, 0, 0], [1.0, 0, 0], [0, 2.0, 0], [0, 0, 3.0]]) + at
    return Tetrahedron(vertices, np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))


MESHES = [
    (4, tetrahedron((0, 0, 0))),
    (7, tetrahedron((5, 0, 0))),
    (9, tetrahedron((0, 5, 0))),
    (11, tetrahedron((0, 0, 9))),
]


def motions() -> Motions:
    """Grains 4, 7 and 9; the last is gone."""
    still = Motions.identity(np.array([4, 7, 9]), np.array([[0.3, 0.4, 0.5], [5.2, 0.1, 0.3], [0.1, 5.2, 0.3]]))
    covariances = np.tile(np.diag([0.01, 0.02, 0.03, 0.001, 0.002, 0.003]) ** 2, (3, 1, 1))
    return replace(
        still,
        translations=np.array([[1.0, 2.0, 3.0], [-1.0, 0.5, 0.0], [np.nan] * 3]),
        rotations=np.array([[0.0, 0.0, np.pi / 2], [0.3, -0.2, 0.1], [np.nan] * 3]),
        covariances=covariances,
        statuses=np.array(["converged", "poorly-determined", "absent"], dtype="<U20"),
        reasons=("", "poorly determined: rotation about its axis", "it is not on the radiographs"),
        residuals=np.array([0.01, 0.02, np.nan]),
        iterations=np.array([3, 4, 0]),
    )


def test_surfaces_are_moved_by_the_motions_of_their_grains(tmp_path):
    write_surfaces_vtp(tmp_path / "s.vtp", MESHES, motions())
    mesh = pyvista.read(tmp_path / "s.vtp")
    assert mesh.n_points == 8  # grain 9 is gone, grain 11 has no motion
    assert mesh.is_all_triangles
    x, c = MESHES[0][1].vertices, motions().centers[0]
    turned = (x - c)[:, [1, 0, 2]] * [-1, 1, 1]  # 90 degrees about z: x to y
    np.testing.assert_allclose(mesh.points[:4], turned + c + motions().translations[0], atol=1e-6)
    second = (MESHES[1][1].vertices - motions().centers[1]) @ rotation_matrix([0.3, -0.2, 0.1]).T
    np.testing.assert_allclose(mesh.points[4:], second + [-1, 0.5, 0] + motions().centers[1], atol=1e-6)
    np.testing.assert_array_equal(mesh.regular_faces[:4], MESHES[0][1].faces)
    assert mesh.volume == pytest.approx(2.0)  # two of 1 each, all triangles outwards
    np.testing.assert_array_equal(mesh["label"], [4] * 4 + [7] * 4)


def test_numbers_of_a_grain_are_at_each_of_its_points(tmp_path):
    write_surfaces_vtp(tmp_path / "s.vtp", MESHES, motions())
    write_grains_vtp(tmp_path / "p.vtp", motions())
    surface, points = pyvista.read(tmp_path / "s.vtp"), pyvista.read(tmp_path / "p.vtp")
    named = set(points.point_data) - {"rotation_matrix", "displacement_covariance", "status", "reason"}
    assert set(surface.point_data) == named
    for name in named:
        expected = np.repeat(np.asarray(points[name])[:2], 4, axis=0)
        np.testing.assert_allclose(surface[name], expected, rtol=1e-6, err_msg=name)


def test_no_grains_make_an_empty_surface(tmp_path):
    nothing = Motions.identity(np.zeros(0, int), np.zeros((0, 3)))
    write_surfaces_vtp(tmp_path / "s.vtp", MESHES, nothing)
    assert pyvista.read(tmp_path / "s.vtp").n_points == 0


def test_points_hold_every_column_of_the_table(tmp_path):
    written = motions()
    write_grains_vtp(tmp_path / "p.vtp", written)
    points, table = pyvista.read(tmp_path / "p.vtp"), written.to_table()
    places = {"x": ("reference_center", 0), "y": ("reference_center", 1), "z": ("reference_center", 2)}
    groups = {"u": "displacement", "w": "rotation_vector_deg", "sd_u": "sd_displacement", "sd_w": "sd_rotation_deg"}
    places |= {f"{short}{axis}": (name, k) for short, name in groups.items() for k, axis in enumerate("xyz")}
    for column in table.columns:
        name, k = places.get(column, (column, None))
        values = np.asarray(points[name] if k is None else points[name][:, k])
        if column in ("status", "reason"):
            assert list(values) == list(table[column])
        else:
            np.testing.assert_allclose(values, table[column].to_numpy(float), err_msg=column)
    assert points["displacement_magnitude"][0] == pytest.approx(np.sqrt(14))
    assert points["rotation_angle_deg"][0] == pytest.approx(90)


def test_arrows_as_the_page_says(tmp_path):
    """Threshold on ok_translation, then glyphs along and as long as the displacement."""
    told = replace(motions(), ok_translation=np.array([True, True, False]))
    write_grains_vtp(tmp_path / "p.vtp", told)
    good = pyvista.read(tmp_path / "p.vtp").threshold(1, scalars="ok_translation")
    arrows = good.glyph(orient="displacement", scale="displacement_magnitude", geom=pyvista.Line((0, 0, 0), (1, 0, 0)))
    ends = arrows.points.reshape(-1, 2, 3)
    np.testing.assert_allclose(ends[:, 0], told.centers[:2] + told.translations[:2], atol=1e-5)
    np.testing.assert_allclose(ends[:, 1] - ends[:, 0], told.translations[:2], atol=1e-5)


def test_file_says_what_its_codes_units_and_frame_are(tmp_path):
    write_grains_vtp(tmp_path / "p.vtp", motions(), time=2.5)
    points = pyvista.read(tmp_path / "p.vtp")
    names = dict(text.split(" ", 1) for text in points.field_data["status_names"])
    assert [names[str(code)] for code in points["status_code"]] == list(points["status"])
    assert names["-1"] == "reference"
    assert "grainmotion" in points.field_data["software"][0]
    assert "z up" in points.field_data["frame"][0]
    assert "lengths mm" in list(points.field_data["units"])
    assert points.field_data["TimeValue"][0] == 2.5


def test_collection_has_a_time_step_a_state(tmp_path):
    still = Motions.identity(motions().labels, motions().centers)
    folder = tmp_path / "step 1 & 2"
    files = [(0.0, tmp_path / "reference.vtp"), (1.5, folder / "grains.vtp")]
    write_grains_vtp(files[0][1], still, time=0.0, reference=True)
    write_grains_vtp(files[1][1], motions(), time=1.5)
    write_pvd(tmp_path / "grains.pvd", files)
    moved = Path(tmp_path).rename(tmp_path.parent / f"{tmp_path.name}-elsewhere")  # paths are relative
    reader = pyvista.get_reader(moved / "grains.pvd")
    assert reader.time_values == [0.0, 1.5]
    reader.set_active_time_value(0.0)
    reference = reader.read()[0]
    assert set(reference["status_code"]) == {-1}
    np.testing.assert_array_equal(reference["displacement"], 0)
    reader.set_active_time_value(1.5)
    state = reader.read()[0]
    np.testing.assert_allclose(state.points[0], [1.3, 2.4, 3.5])
    assert set(state.point_data) == set(reference.point_data)
