"""Files of shapes, read back by readers of their own."""

import numpy as np
import pytest
import trimesh

from grainmotion.grain_shapes.clump import clump
from grainmotion.grain_shapes.level_set import level_set, surface_nodes
from grainmotion.grain_shapes.mass_properties import mass_properties
from grainmotion.grain_shapes.triangle_mesh import Surface
from grainmotion.io.dem_shapes import (
    write_clump,
    write_lammps_grid,
    write_level_set_npz,
    write_ls_dem_grain,
    write_stl,
)
from grainmotion.simulate.polyhedra import icosphere

DIRECTIONS, FACES = icosphere(4)
OVAL = Surface(DIRECTIONS * [1.5, 1.0, 0.7], FACES)  # principal axes x, y, z
FIELD = level_set(OVAL, 0.1)
OWN = mass_properties(OVAL)


def distance(points):
    """Nearly the signed distance to the oval, with the right sign."""
    scaled = np.linalg.norm(points / [1.5, 1.0, 0.7], axis=-1)
    return np.linalg.norm(points, axis=-1) * (1 - 1 / np.maximum(scaled, 1e-9))


def test_stl_is_read_by_trimesh(tmp_path):
    write_stl(tmp_path / "a.stl", OVAL, "grain 5")
    mesh = trimesh.load_mesh(tmp_path / "a.stl")
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.euler_number == 2
    assert mesh.volume == pytest.approx(OVAL.volume, rel=1e-5)
    np.testing.assert_allclose(np.sort(np.diagonal(mesh.moment_inertia)), OWN.principal_moments, rtol=1e-4)
    head = (tmp_path / "a.stl").read_bytes()[:80].decode()
    assert head.startswith("grain 5, mm, grainmotion")
    assert not head.startswith("solid")


def test_npz_holds_what_yade_takes(tmp_path):
    write_level_set_npz(tmp_path / "a.npz", FIELD, surface_nodes(OVAL, 0.1), 5)
    with np.load(tmp_path / "a.npz") as data:
        values, low, h = data["distance"], data["minimum"], float(data["spacing"])
        assert int(data["label"]) == 5
        assert "grainmotion" in str(data["made_by"])
        np.testing.assert_allclose(np.abs(distance(data["nodes"].astype(float))).max(), 0, atol=1e-3)
    nx, ny, nz = values.shape
    assert nx > ny > nz
    i, j, k = 18, 14, 12  # distField[i][j][k] is at min + spacing (i, j, k)
    place = low + h * np.array([i, j, k])
    assert values[i, j, k] == pytest.approx(FIELD.values[k, j, i], abs=1e-6)
    assert np.sign(values[i, j, k]) == np.sign(distance(place))
    x = low[0] + h * np.arange(nx)
    inside = x[values[:, ny // 2, nz // 2] < 0]
    assert inside.max() == pytest.approx(1.5, abs=0.1)


def read_ls_dem(path):
    """A grain, as LS-DEM codes read it: line by line, x fastest."""
    lines = iter(path.read_text().splitlines())
    mass = float(next(lines))
    moments, center = (np.array(next(lines).split(), float) for _ in range(2))
    count = int(next(lines))
    nodes = np.array(next(lines).split(), float).reshape(count, 3)
    radius = float(next(lines))
    nx, ny, nz = (int(n) for n in next(lines).split())
    values = np.array(next(lines).split(), float)
    assert len(values) == nx * ny * nz
    return mass, moments, center, nodes, radius, lambda x, y, z: values[z * ny * nx + y * nx + x], (nx, ny, nz)


def test_ls_dem_grain(tmp_path):
    write_ls_dem_grain(tmp_path / "a.dat", FIELD, surface_nodes(OVAL, 0.1), OWN)
    mass, moments, center, nodes, radius, value, (nx, ny, nz) = read_ls_dem(tmp_path / "a.dat")
    volume = 4 / 3 * np.pi * 15 * 10 * 7
    assert mass == pytest.approx(volume, rel=0.02)
    np.testing.assert_allclose(moments, volume / 5 * np.array([149, 274, 325.0]), rtol=0.03)
    np.testing.assert_allclose(np.abs(distance(nodes * 0.1)).max(), 0, atol=2e-3)
    assert radius == pytest.approx(15, rel=0.01)
    for x, y, z in ((2, 2, 2), (nx // 2 + 12, ny // 2, nz // 2), (nx // 2 + 9, ny // 2 - 6, nz // 2 + 2)):
        exact = distance((np.array([x, y, z]) - center) * 0.1)
        assert np.sign(value(x, y, z)) == np.sign(exact)
    assert value(round(center[0]), round(center[1]), round(center[2])) == pytest.approx(-7, abs=0.6)


def test_lammps_grid(tmp_path):
    write_lammps_grid(tmp_path / "a.txt", FIELD, OWN, 5)
    lines = (tmp_path / "a.txt").read_text().splitlines()
    assert lines[0].startswith("#")
    assert "mm" in lines[0]
    nx, ny, nz = (int(n) for n in lines[1].split())
    stride, low = float(lines[2]), np.array(lines[3].split(), float)
    values = np.array(lines[4:], float)
    assert len(values) == nx * ny * nz
    z, y, x = np.meshgrid(*(np.arange(n) for n in (nz, ny, nx)), indexing="ij")
    exact = distance(low + stride * np.stack([x, y, z], axis=-1)).ravel()
    assert (np.sign(values) == np.sign(exact))[np.abs(exact) > 0.05].all()
    centre = (values < 0).astype(float) @ np.stack([x, y, z], axis=-1).reshape(-1, 3) / (values < 0).sum()
    np.testing.assert_allclose(low + stride * centre, 0, atol=0.02)


def test_clump_lines(tmp_path):
    found = clump(OVAL, 0.1, spheres=5)
    write_clump(tmp_path / "a.txt", found, 5)
    text = (tmp_path / "a.txt").read_text()
    assert text.splitlines()[0] == "#format x_y_z_r"  # YADE's textExt reads the format from it
    rows = np.loadtxt(tmp_path / "a.txt")
    np.testing.assert_allclose(rows[:, :3], found.centers, atol=1e-6)
    np.testing.assert_allclose(rows[:, 3], found.radii, rtol=1e-6)
