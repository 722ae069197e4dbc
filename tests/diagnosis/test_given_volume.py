"""A volume made by other software, held against radiographs of the same and of a moved state."""

from __future__ import annotations

import numpy as np
import pytest

from convex_grains import VOXEL, ConvexGrains
from grainmotion.diagnosis.given_volume import check_volume
from grainmotion.model.finding import Level
from grainmotion.model.volume import Volume

TURN = tuple(np.arange(40) * 9.0)


@pytest.fixture(scope="module")
def grains():
    return ConvexGrains.random(3, 12)


@pytest.fixture(scope="module")
def volume(grains):
    return grains.voxels()[0]


@pytest.fixture(scope="module")
def moved(grains):
    """Four radiographs of grains that moved by up to 1.5 voxels and 5 degrees along each axis."""
    return grains.moved(8, 1.5 * VOXEL, 5.0).scan()


@pytest.fixture(scope="module")
def reference(grains):
    return grains.scan(TURN)


def check(array, scan, voxel_size=VOXEL, same_state=False):
    return check_volume(Volume(np.ascontiguousarray(array), voxel_size), None, scan, same_state=same_state)


WRONG = {
    "upside down": (lambda a: a[::-1], 1.0, "upside down"),
    "turned": (lambda a: np.rot90(a, 1, (1, 2)), 1.0, "turned by -90 degrees about z"),
    "x y z": (lambda a: a.T, 1.0, "in the order x y z of axes"),
    "1/cm": (lambda a: 10 * a, 1.0, "in 1/cm"),
    "8 bit": (lambda a: 255 * a / a.max(), 1.0, "grey values"),
    "air at 8000": (lambda a: 8000 + 1e5 * a, 1.0, "grey values"),
    "voxels": (lambda a: a, 2.0, "by a factor of 2 too large"),
}


@pytest.mark.parametrize("name", WRONG)
def test_mistakes_are_named_from_a_moved_state(volume, moved, name):
    change, scale, words = WRONG[name]
    findings = check(change(volume.array), moved, scale * VOXEL)
    assert findings[0].level is Level.ERROR
    assert words in findings[0].fact


def test_a_right_volume_has_no_finding(volume, moved, reference):
    assert check(volume.array, moved) == ()
    assert check(volume.array, reference, same_state=True) == ()


@pytest.mark.parametrize("scale", [0.98, 1.02])
def test_two_per_cent_of_voxel_size_against_the_same_state(volume, reference, scale):
    (finding,) = check(volume.array, reference, scale * VOXEL, same_state=True)
    assert "2% too" in finding.fact
    assert float(finding.remedy.split("= ")[1].split(",")[0]) == pytest.approx(VOXEL, rel=0.006)


def test_a_shift_against_the_same_state(volume, reference):
    (finding,) = check(np.roll(volume.array, (1, 0, -2), (0, 1, 2)), reference, same_state=True)
    assert "does not lie where" in finding.fact
    center = [float(c) for c in finding.remedy.split("[")[1].rstrip("]").split(",")]
    np.testing.assert_allclose(center, np.array([2, 0, -1]) * VOXEL, atol=0.3 * VOXEL)


def test_part_of_the_sample(volume, moved):
    assert any("smaller than the sample" in f.fact for f in check(volume.array[14:30, 12:28, 12:28], moved))


@pytest.mark.parametrize("cut", [8, 10])
def test_part_of_the_sample_is_not_taken_for_a_sample_of_smaller_voxels(cut):
    grains = ConvexGrains.random(8, 12)
    middle = grains.voxels()[0].array[cut:-cut, cut:-cut, cut:-cut]
    (finding,) = check(middle, grains.moved(8, 1.5 * VOXEL, 5.0).scan())
    assert "smaller than the sample" in finding.fact


@pytest.mark.parametrize("seed", range(3))
def test_a_mirrored_volume_of_grains_that_moved_far_and_another_sample(seed):
    grains = ConvexGrains.random(seed, 6)
    scan = grains.moved(seed + 50, 4 * VOXEL, 10.0).scan()
    (mirrored,) = check(grains.voxels()[0].array[:, :, ::-1], scan)
    assert mirrored.level is Level.ERROR
    assert "mirrored along x" in mirrored.fact
    others = check(ConvexGrains.random(seed + 100, 6).voxels()[0].array, scan)
    assert all(f.level is not Level.ERROR for f in others)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(20))
def test_seeds(seed):
    """Right volumes give no warning; upside down, other axes, units and a factor of 2 are named."""
    grains = ConvexGrains.random(seed, 8 + seed % 8)
    array = grains.voxels()[0].array
    scan = grains.moved(seed + 5, 2 * VOXEL, 6.0).scan(seed=seed)
    assert all(f.level is Level.NOTE for f in check(array, scan))
    for change, scale, words in WRONG.values():
        findings = check(change(array), scan, scale * VOXEL)
        assert any(words in f.fact and f.level is not Level.NOTE for f in findings)
