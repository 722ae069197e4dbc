"""The folder `dem`: tables read by pandas, poses of LS-DEM by its own formula, the script run with a stub of YADE."""

import dataclasses
import sys
import types

import numpy as np
import pandas as pd
import pytest
import trimesh

from few_grains import grain_set
from grainmotion.grain_shapes.poses import State
from grainmotion.grain_shapes.rigid_body import rigid_bodies
from grainmotion.grain_shapes.settings import DemSettings
from grainmotion.io.dem_folder import write_dem_folder
from grainmotion.model.grains import Grain
from grainmotion.model.motions import Motions, Status
from grainmotion.model.volume import Volume

SETTINGS = DemSettings(codes=("yade", "ls-dem", "lammps"), spheres=5, degree=4)
SHIFT, TURN = np.array([0.3, -0.2, 0.1]), np.array([0.2, 0.5, -0.4])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Three grains, in the later state the second lost and the third misfitted, and a fourth without a surface."""
    grains = grain_set(3, finer=1)
    speck = np.zeros((8, 8, 8), np.float32)
    speck[4, 4, 4] = 1
    small = Grain(9, Volume(speck, grains.voxel_size), np.zeros(3))
    grains = dataclasses.replace(grains, grains=(*grains.grains, small))
    motions = Motions.identity(grains.labels, grains.centers)
    statuses = np.array([Status.CONVERGED.value] * 4, dtype="<U20")
    statuses[1] = Status.ABSENT.value
    statuses[2] = Status.NOT_CONVERGED.value
    motions = dataclasses.replace(
        motions, statuses=statuses, translations=np.tile(SHIFT, (4, 1)), rotations=np.tile(TURN, (4, 1))
    )
    out = tmp_path_factory.mktemp("dem") / "dem"
    (out / "stl").mkdir(parents=True)
    (out / "stl" / "grain_00077.stl").write_bytes(b"of an older export")
    (out / "stl" / "mine.stl").write_bytes(b"of the user")
    write_dem_folder(out, rigid_bodies(grains, SETTINGS), [State("one", motions, 60.0)], SETTINGS)
    return out


@pytest.fixture(scope="module")
def tables(folder):
    return {p.stem: pd.read_csv(p) for p in folder.glob("*.csv")}


def test_every_grain_is_listed_and_what_is_missing_has_a_reason(tables):
    grains = tables["grains"]
    assert list(grains["label"]) == [1, 2, 3, 9]
    assert "1 voxels" in grains["reason"].iloc[3]
    assert grains["reason"].iloc[:3].isna().all()
    assert np.isnan(grains["volume"].iloc[3])
    assert list(tables["poses"]["label"]) == [1, 2, 3, 1, 2, 3]


def test_files_of_an_older_export_are_removed_and_others_stay(folder):
    assert sorted(p.name for p in (folder / "stl").iterdir()) == [
        *(f"grain_0000{k}.stl" for k in (1, 2, 3)),
        "mine.stl",
    ]


def test_stl_moved_by_the_pose_has_the_inertia_of_the_table(folder, tables):
    """Reference pose and STL, by trimesh alone: centre, volume and inertia in the sample frame."""
    for row in tables["grains"].iloc[:3].itertuples():
        mesh = trimesh.load_mesh(folder / "stl" / f"grain_{row.label:05d}.stl")
        pose = tables["poses"].query(f"state == 'reference' and label == {row.label}").iloc[0]
        place = trimesh.transformations.quaternion_matrix(pose[["qw", "qx", "qy", "qz"]].to_numpy(float))
        place[:3, 3] = pose[["x", "y", "z"]].to_numpy(float)
        mesh.apply_transform(place)
        assert mesh.volume == pytest.approx(row.volume, rel=1e-5)
        np.testing.assert_allclose(mesh.center_mass, [row.x, row.y, row.z], atol=1e-5)
        tensor = mesh.moment_inertia[[0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]]
        found = [row.ixx, row.iyy, row.izz, row.iyz, row.ixz, row.ixy]
        np.testing.assert_allclose(found, tensor, atol=1e-4 * row.izz)


def test_poses_hold_mass_and_inertia_in_every_state(tables):
    for state in ("reference", "one"):
        rows = tables["poses"].query(f"state == '{state}'")[["volume", "i1", "i2", "i3"]].to_numpy()
        np.testing.assert_allclose(rows, tables["grains"][["volume", "i1", "i2", "i3"]].to_numpy()[:3])


def test_lost_grains_are_empty_and_velocities_are_per_second(tables):
    later = tables["poses"].query("state == 'one'")
    assert later[["x", "qw", "vx", "spin_x"]].iloc[1].isna().all()
    assert later["status"].iloc[1] == "absent"
    assert (later["velocity_per"] == "s").all()
    rate = later[["spin_x", "spin_y", "spin_z"]].iloc[0].to_numpy(float)
    np.testing.assert_allclose(rate, np.rad2deg(TURN) / 60, rtol=1e-6)


def test_harmonics_and_clumps_tell_the_grain(tables):
    harmonics, grains = tables["harmonics"], tables["grains"]
    zonal = harmonics.query("l == 0 and m == 0")["a"].to_numpy() / np.sqrt(4 * np.pi)
    size = np.cbrt(3 / 4 / np.pi * grains["volume"].iloc[:3])
    np.testing.assert_allclose(zonal, size, rtol=0.06)
    assert harmonics.groupby("label").size().tolist() == [25, 25, 25]
    assert (tables["clumps"].groupby("label").size() <= 5).all()


def test_ls_dem_rotations_by_the_formula_of_its_codes(folder, tables):
    """Its rotation matrix of a quaternion (q0, q1, q2, q3), as published codes compute it, is that of the poses."""
    labels = np.loadtxt(folder / "ls-dem" / "labels_one.dat", dtype=int, ndmin=1)
    assert labels.tolist() == [1]  # 2 is absent, the place of 3 is no result to use
    places = np.loadtxt(folder / "ls-dem" / "positions_one.dat", ndmin=2)
    for label, place, (a, b, c, d) in zip(labels, places, np.loadtxt(folder / "ls-dem" / "rotations_one.dat", ndmin=2)):
        theirs = np.array([
            [b * b + d * d - a * a - c * c, 2 * (c * d - a * b), 2 * (b * c + a * d)],
            [-2 * (a * b + c * d), a * a + d * d - b * b - c * c, 2 * (b * d - a * c)],
            [2 * (b * c - a * d), -2 * (a * c + b * d), c * c + d * d - a * a - b * b],
        ])  # fmt: skip
        pose = tables["poses"].query(f"state == 'one' and label == {label}").iloc[0]
        ours = trimesh.transformations.quaternion_matrix(pose[["qw", "qx", "qy", "qz"]].to_numpy(float))[:3, :3]
        np.testing.assert_allclose(theirs, ours, atol=1e-7)
        np.testing.assert_allclose(place * 0.1, pose[["x", "y", "z"]].to_numpy(float), atol=1e-6)


def test_the_script_makes_bodies_of_yade(folder, tables, monkeypatch):
    """A stub takes YADE's place: what `levelSetBody` and `RegularGrid` get is what they ask for."""
    made = {}

    class Anything:
        def __init__(self, *args, **options):
            self.args, self.__dict__["options"] = args, options

        def append(self, body):
            return len(made)

    def body(**options):
        made[len(made)] = options
        return options

    yade = types.ModuleType("yade")
    names = "RegularGrid Quaternion FrictMat ForceResetter InsertionSortCollider Bo1_LevelSet_Aabb InteractionLoop"
    names += " Ig2_LevelSet_LevelSet_ScGeom Ip2_FrictMat_FrictMat_FrictPhys Law2_ScGeom_FrictPhys_CundallStrack"
    for name in (*names.split(), "NewtonIntegrator"):
        setattr(yade, name, Anything)
    yade.Vector3 = lambda *args: args
    yade.Vector3i = lambda *args: args
    yade.levelSetBody = body
    yade.O = types.SimpleNamespace(materials=Anything(), bodies=Anything(), engines=[])
    monkeypatch.setitem(sys.modules, "yade", yade)
    monkeypatch.chdir(folder)
    monkeypatch.setenv("STATE", "one")
    scope = {}
    exec((folder / "yade_level_sets.py").read_text(), scope)
    assert list(scope["bodies"]) == [1]
    first, pose = made[0], tables["poses"].query("state == 'one' and label == 1").iloc[0]
    grid = first["grid"].options
    assert np.shape(first["distField"]) == grid["nGP"]
    assert grid["spacing"] == pytest.approx(1e-4)
    assert all(m < 0 for m in grid["min"])
    np.testing.assert_allclose(first["center"], pose[["x", "y", "z"]].to_numpy(float) * 1e-3)
    np.testing.assert_allclose(first["orientation"].args, pose[["qw", "qx", "qy", "qz"]].to_numpy(float))
    assert len(first["surfNodes"]) > 50


def test_every_file_says_what_it_is(folder):
    text = (folder / "README.txt").read_text()
    for words in ("mm", "poses.csv", "ls-dem/", "lammps/", "(y, -x, -z, w)", "grainmotion"):
        assert words in text
    for table in folder.glob("*.csv"):
        listed = text.split(f"Columns of {table.name}:\n")[1].split("\n\n")[0].splitlines()
        assert [line.split()[0] for line in listed] == list(pd.read_csv(table).columns)
