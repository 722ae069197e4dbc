"""Gaps between layers of grains that a cone-beam scan blurs along its axis (`segmentation.blurred_gaps`).

A flat sample high above the source: its layers are as wide, over the slope of the rays, as those at the top of a
cylinder of 1000³ voxels.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from grainmotion.model.geometry import Geometry
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.projection.volumes import project
from grainmotion.reconstruction.reconstruct import reconstruct
from grainmotion.reconstruction.settings import ReconstructSettings
from grainmotion.segmentation.blocks import Work
from grainmotion.segmentation.blurred_gaps import is_blurred_gap, length_along_axis
from grainmotion.segmentation.segment import segment

RADIUS, SPACING, LAYERS, ACROSS = 8.0, 18.0, 4, 8  # voxels; grains
SHAPE = (LAYERS * 18 + 12, ACROSS * 18 + 4, ACROSS * 18 + 4)
DISTANCE, HEIGHT, VIEWS = 300.0, 90.0, 120  # of the axis from the source and of the sample above it, voxels
NOISE = 0.02


@cache
def layers() -> tuple[np.ndarray, np.ndarray]:
    """Labels of balls in horizontal layers, and the share of each voxel that they fill."""
    rng = np.random.default_rng(0)
    places = np.stack(np.meshgrid(*(np.arange(n) for n in (LAYERS, ACROSS, ACROSS)), indexing="ij"), axis=-1)
    places = (places.reshape(-1, 3) + 0.5) * SPACING + (6, 2, 2)
    places = places[np.hypot(places[:, 1] - SHAPE[1] / 2, places[:, 2] - SHAPE[2] / 2) < SHAPE[1] / 2 - RADIUS - 2]
    centers = places + rng.uniform(-0.5, 0.5, places.shape)
    stretches = np.exp(rng.uniform(-0.18, 0.18, centers.shape))
    labels, share = np.zeros(SHAPE, np.int32), np.zeros(SHAPE, np.float32)
    for label, (center, stretch) in enumerate(zip(centers, stretches, strict=True), start=1):
        low = np.round(center).astype(int) - 10
        box = tuple(slice(max(a, 0), a + 21) for a in low)
        cells = np.moveaxis(np.indices(labels[box].shape), 0, -1) + [s.start for s in box]
        depth = RADIUS - np.linalg.norm((cells - center) / stretch, axis=-1)
        labels[box][depth > 0] = label
        share[box] = np.maximum(share[box], np.clip(depth + 0.5, 0, 1))
    return labels, share


def liquid(height: int = SHAPE[0] - 8) -> np.ndarray:
    """Where a liquid stands up to a height, around the grains."""
    z, y, x = np.indices(SHAPE)
    return (z >= 8) & (z < height) & (np.hypot(y - SHAPE[1] / 2, x - SHAPE[2] / 2) < SHAPE[1] / 2 - 2)


def scanned(exact: np.ndarray) -> Volume:
    """A volume as a cone beam from far below reconstructs it."""
    volume = Volume(0.02 * exact.astype(np.float32), 1.0, (0, 0, HEIGHT))
    half = SHAPE[0] / 2
    ends = [2 * (HEIGHT + side * half) * DISTANCE / (DISTANCE - side * SHAPE[1] / 2) for side in (-1, 1)]
    rows, columns = int((ends[1] - ends[0]) / 2) + 8, int(SHAPE[1] / (1 - SHAPE[1] / 2 / DISTANCE)) + 2
    geometry = Geometry.cone(
        np.arange(VIEWS) * 360 / VIEWS,
        (rows, columns),
        2.0,
        source_to_axis=DISTANCE,
        source_to_detector=2 * DISTANCE,
        detector_offset=(0.0, sum(ends) / 2),
    )
    images = project(volume, geometry)
    images += np.random.default_rng(1).normal(0, NOISE, images.shape).astype(np.float32)
    grid = Volume.zeros(SHAPE, 1.0, volume.center)
    return reconstruct(Scan(images, geometry), grid, ReconstructSettings(outline="grid")).volume


def test_blurred_gaps_are_no_phase():
    labels, share = layers()
    segmentation = segment(scanned(share))
    assert [phase.kind for phase in segmentation.phases] == ["air", "grains"]
    assert segmentation.labels.max() == labels.max()


def test_a_liquid_between_blurred_layers_is_found():
    labels, share = layers()
    segmentation = segment(scanned(share + 0.35 * (1 - share) * liquid()))
    assert "liquid" in [phase.kind for phase in segmentation.phases]
    assert segmentation.labels.max() >= labels.max()


@pytest.mark.parametrize(("lengths", "expected"), [((2, 20, 20), 0.1), ((10, 10, 10), 1.0), ((20, 4, 4), 5.0)])
def test_length_along_the_axis_over_that_across_it(lengths, expected):
    codes = np.zeros((40, 40, 40), np.uint8)
    codes[tuple(slice(5, 5 + n) for n in lengths)] = 2
    assert length_along_axis(codes, 2, Work()) == pytest.approx(expected)
    assert length_along_axis(codes, 3, Work()) == 0


@pytest.mark.parametrize(
    ("lengths", "tenths", "blurred"),
    [((2, 20, 20), (0.5, 1.6), True), ((2, 20, 20), (0.9, 1.1), False), ((10, 10, 10), (0.5, 1.6), False)],
)
def test_a_sheet_of_one_attenuation_is_a_plate_and_a_continuum_in_all_directions_is_none(lengths, tenths, blurred):
    codes = np.zeros((40, 40, 40), np.uint8)
    codes[tuple(slice(5, 5 + n) for n in lengths)] = 2
    assert is_blurred_gap(codes, 2, (tenths[0], 1.0, tenths[1]), Work()) == blurred
