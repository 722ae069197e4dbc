"""Distances that are wrong in their ratio to the pixel size are named; those that only scale all lengths cannot be."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from grainmotion.diagnosis.scan_geometry import check_scan
from grainmotion.model.finding import Level
from grainmotion.model.geometry import Geometry
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.simulate import PackingSettings, Particle, Physics, pack, record_line_integrals, stone

VOXEL, PANEL = 0.125, (56, 56)
ANGLES = tuple(np.arange(60) * 6.0)


def geometry(source_to_axis: float = 120.0, source_to_detector: float = 480.0, pixel: float = 4 * VOXEL) -> Geometry:
    """A full scan."""
    return Geometry.cone(ANGLES, PANEL, pixel, source_to_axis=source_to_axis, source_to_detector=source_to_detector)


@cache
def line_integrals(seed: int = 0) -> np.ndarray:
    """Radiographs of eight stones of 14 voxels, in the true geometry."""
    shapes = [stone(seed + k, 14 * VOXEL, 3) for k in range(8)]
    sample = pack([Particle(shape, 0.2) for shape in shapes], PackingSettings(16 * VOXEL), seed)
    middle = np.mean([p.center for p in sample.particles], axis=0)
    particles = tuple(p.moved(np.eye(3), -middle) for p in sample.particles)
    return record_line_integrals(type(sample)(particles), geometry(), Physics(photons=2e4), seed).line_integrals


def facts(told: Geometry, size: int = 56) -> list[str]:
    found = check_scan(Scan(line_integrals(), told), Volume.zeros((size, size, size), VOXEL))
    assert all(f.level is not Level.NOTE for f in found)
    return [f.fact for f in found]


def test_right_distances_give_no_finding():
    assert facts(geometry()) == []


def test_lengths_that_are_scaled_alike_cannot_be_told():
    assert facts(geometry(source_to_axis=132.0)) == []


@pytest.mark.parametrize(
    ("told", "size", "cause"),
    [
        ({"pixel": 8 * VOXEL}, 112, "pixel_size is told twice as large"),
        ({"pixel": 2 * VOXEL}, 28, "pixel_size is told half as large"),
        ({"source_to_axis": 120.0, "source_to_detector": 240.0}, 112, ""),
    ],
)
def test_another_angle_of_the_rays_is_named_with_its_cause(told: dict[str, float], size: int, cause: str):
    (fact,) = facts(geometry(**told), size)
    assert "the rays spread over a" in fact
    assert cause in fact


def test_a_volume_that_does_not_hold_the_sample_is_named():
    (fact,) = facts(geometry(), 24)
    assert "the volume is smaller than the sample" in fact


def test_coarse_voxels_are_named():
    scan = Scan(line_integrals(), geometry())
    (found,) = check_scan(scan, Volume.zeros((28, 28, 28), 2 * VOXEL))
    assert "the voxels are 2.0 times as large as a pixel" in found.fact


def test_a_level_of_all_views_alike_is_named():
    """The volume is narrower than the panel; where it is as wide, the level is a cylinder of the sample."""
    scan = Scan(line_integrals() + np.float32(np.log(3)), geometry())
    (found,) = check_scan(scan, Volume.zeros((56, 48, 48), VOXEL))
    assert found.check == "beam-level"
    assert "darker than the flats by a factor of 3.00" in found.fact


def test_angles_of_another_scan_are_named():
    """Sorted golden angles told for equal steps leave a low residual."""
    golden = np.sort(np.arange(60) * 137.508 % 360)
    told = Geometry.cone(golden, PANEL, 4 * VOXEL, source_to_axis=120.0, source_to_detector=480.0)
    (found,) = check_scan(Scan(line_integrals(), told), Volume.zeros((56, 56, 56), VOXEL))
    assert (found.level, found.fix) == (Level.ERROR, "equal-steps")
