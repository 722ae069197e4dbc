"""Strains, contacts, fabric and cells against spam's own figures on the same grains; marked `spam`.

spam's frame is z y x: tensors compare with both axes reversed.
"""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

from grainmotion.mechanics.contacts import contacts
from grainmotion.mechanics.fabric import fabric
from grainmotion.mechanics.finite_strain import Deformation
from grainmotion.mechanics.strains import strains
from grainmotion.mechanics.tetrahedra import tessellate
from grainmotion.mechanics.void_ratio import void_ratio
from grainmotion.model.volume import Volume
from grainmotion.rotations import rotation_matrix
from grainmotion.segmentation.extraction import grains_from_labels
from known_contacts import contacts_along
from spheres import known_motions, voxelised

pytestmark = pytest.mark.spam
ROOT = Path(__file__).parents[2]
SCRIPTS = {
    "strain": """
import sys, numpy, spam.deformation, spam.mesh
data = numpy.load(sys.argv[1])
F = spam.deformation.FfieldBagi(data["points"], data["simplices"], data["displacements"], nProcesses=1)
parts = [spam.deformation.decomposeF(f) for f in F.astype(float)]
numpy.savez(sys.argv[2], F=F, **{k: [p[k] for p in parts] for k in ("vol", "dev", "volss", "devss", "e", "r")})
""",
    "labels": """
import sys, numpy, spam.label
labels = numpy.load(sys.argv[1])["labels"]
_, coordination, _, pairs = spam.label.labelledContacts(labels)
cells = spam.label.setVoronoi(labels, maxPoreRadius=10)
numpy.savez(sys.argv[2], pairs=pairs, cells=numpy.bincount(cells.ravel()), coordination=coordination)
""",
    "fabric": """
import sys, numpy, spam.orientations
N, F, a = spam.orientations.fabricTensor(numpy.load(sys.argv[1])["normals"])
numpy.savez(sys.argv[2], N=N, F=F, a=a)
""",
}


def in_spam(folder: Path, script: str, **arrays: np.ndarray) -> dict[str, np.ndarray]:
    """What one of the scripts makes of the arrays, in the environment that holds spam."""
    python = Path(os.environ.get("GRAINMOTION_SPAM_PYTHON", ROOT / ".venv-spam" / "bin" / "python"))
    if not python.exists():
        pytest.fail(f"{python} is missing: run `make test-spam`, or let GRAINMOTION_SPAM_PYTHON name one with spam")
    np.savez(folder / "in.npz", **arrays)
    command = [str(python), "-c", SCRIPTS[script], str(folder / "in.npz"), str(folder / "out.npz")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    return dict(np.load(folder / "out.npz"))


def reversed_axes(tensors: np.ndarray) -> np.ndarray:
    """Tensors ``(..., 3, 3)`` of spam's frame in x y z."""
    return tensors[..., ::-1, ::-1]


def test_strains_are_those_of_spam(tmp_path):
    """F of each tetrahedron, and all that spam derives from it; spam's F is in single precision."""
    random = np.random.default_rng(5)
    points = random.uniform(-5, 5, (60, 3))
    gradient = rotation_matrix([0.2, -0.3, 0.1]) @ np.diag([1.1, 0.95, 0.9])
    shifts = points @ (gradient - np.eye(3)).T + random.normal(0, 0.05, points.shape)
    cells = tessellate(points)
    good = cells.shapes > 0.3
    found = cells.weights.gradients(shifts)[good]
    theirs = in_spam(
        tmp_path, "strain", points=points[:, ::-1], simplices=cells.simplices[good], displacements=shifts[:, ::-1]
    )
    np.testing.assert_allclose(found, reversed_axes(theirs["F"]), atol=2e-5)
    ours = Deformation(found)
    np.testing.assert_allclose(ours.volumetric, theirs["vol"], atol=5e-5)
    np.testing.assert_allclose(ours.deviatoric, theirs["dev"], atol=5e-5)
    np.testing.assert_allclose(ours.small[:, :3].sum(axis=1), theirs["volss"], atol=5e-5)
    # the rotation vector of the mirrored frame is reversed and negated
    np.testing.assert_allclose(np.rad2deg(ours.rotations), -theirs["r"][:, ::-1], atol=0.01)


def test_the_average_around_a_grain_is_that_of_spams_tetrahedra(tmp_path):
    random = np.random.default_rng(6)
    points = random.uniform(-5, 5, (60, 3))
    shifts = 0.02 * np.stack([points[:, 0] * points[:, 1], points[:, 2] ** 2, points[:, 0]], axis=1)
    cells, ours = tessellate(points), strains(known_motions(points, shifts))
    theirs = in_spam(
        tmp_path, "strain", points=points[:, ::-1], simplices=cells.simplices, displacements=shifts[:, ::-1]
    )
    inner = np.flatnonzero(~ours.at_hull)
    for grain in inner[:10]:
        around = (cells.simplices == grain).any(axis=1)
        mean = np.average(reversed_axes(theirs["F"])[around], axis=0, weights=cells.volumes[around])
        np.testing.assert_allclose(ours.gradients[grain], mean, atol=5e-4)


@pytest.fixture(scope="module")
def packing():
    """Spheres of 9 voxels radius: neighbours of the cubic lattice touch along x, are 1.2 apart along y, 4 along z."""
    radius, steps = 9.0, np.array([-1.0, 0, 1])
    places = np.stack(np.meshgrid(steps * 2 * radius, steps * (2 * radius + 1.2), steps * (2 * radius + 4)), axis=-1)
    centers = places.reshape(-1, 3) + np.array([0.1, 0.2, 0.3])
    array, labels = voxelised(centers, np.full(27, radius), (76, 72, 70), blur=1.0)
    volume = Volume(array, 1.0)
    return labels, volume, grains_from_labels(volume, labels)


def test_labels_touch_where_surfaces_do_not(packing, tmp_path):
    """spam counts labels that share faces: all 18 pairs along x; surfaces here are those, and the gaps are told."""
    labels, _, grains = packing
    theirs = in_spam(tmp_path, "labels", labels=labels.astype("<u4"))
    found = contacts(grains)
    ours = {tuple(pair) for pair in found.pairs[found.touching].tolist()}
    adjacent = {tuple(sorted(pair)) for pair in theirs["pairs"].tolist()}
    along = {axis: found.pairs[np.abs(found.normals[:, axis]) > 0.9] for axis in (0, 1)}
    assert ours == {tuple(pair) for pair in along[0].tolist()}
    assert len(ours) == 18
    assert ours <= adjacent
    np.testing.assert_allclose(found.gaps[np.abs(found.normals[:, 1]) > 0.9], 1.2, atol=0.3)


def test_cells_are_those_of_spam(packing, tmp_path):
    """spam's set Voronoi cells are in whole voxels: those of the middle agree within 3 %."""
    labels, volume, grains = packing
    theirs = in_spam(tmp_path, "labels", labels=labels.astype("<u4"))
    found = void_ratio(grains, volume)
    assert found.inside.any()
    for row in np.flatnonzero(found.inside):
        assert found.cell_volumes[row] == pytest.approx(theirs["cells"][found.labels[row]], rel=0.03)


def test_fabric_is_that_of_spam(tmp_path):
    normals = np.random.default_rng(0).normal(size=(40, 3)) * [1, 1, 2]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    theirs = in_spam(tmp_path, "fabric", normals=normals[:, ::-1])
    found = fabric(contacts_along(normals))
    np.testing.assert_allclose(found.first_kind, reversed_axes(theirs["N"]), atol=1e-12)
    np.testing.assert_allclose(found.third_kind, reversed_axes(theirs["F"]), atol=1e-12)
    assert found.anisotropy == pytest.approx(float(theirs["a"]))
