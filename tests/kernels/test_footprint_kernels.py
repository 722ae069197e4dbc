"""Footprints on the detector: extents of projected points, and the pixels between two lines of each direction."""

import numpy as np
import pytest

from grainmotion.kernels import footprints
from grainmotion.model.geometry import Geometry

PANEL = (30, 44)
VIEWS = {
    "cone": Geometry.cone([0.0, 60.0], PANEL, 0.4, source_to_axis=30, source_to_detector=120),
    "parallel": Geometry.parallel([0.0, 60.0], PANEL, 0.1),
}
DIRECTIONS = footprints.OUTLINE_DIRECTIONS


def extents(geometry, hull, position):
    """Extents of one grain that is not rotated, ``(views, directions, 2)``."""
    frames = np.linalg.inv(np.stack([geometry.u, geometry.v, geometry.rays], axis=-1))
    origins = np.ascontiguousarray(geometry.source if geometry.beam == "cone" else geometry.detector)
    out = np.full((1, len(geometry), len(DIRECTIONS), 2), 7.0)
    footprints.extents(
        np.array([hull], float), np.array([position], float), np.eye(3)[None], frames, origins,
        geometry.beam == "cone", np.array(PANEL), DIRECTIONS, out,
    )  # fmt: skip
    return out[0]


@pytest.mark.parametrize("beam", VIEWS)
def test_extents_are_those_of_the_projected_points(beam):
    geometry = VIEWS[beam]
    hull = np.random.default_rng(0).uniform(-0.5, 0.5, (6, 3))
    position = np.array([0.3, -0.2, 0.4])
    pixels = geometry.project_points(hull + position)  # (views, points, 2): row and column
    along = pixels @ DIRECTIONS.T
    expected = np.stack([along.min(axis=1), along.max(axis=1)], axis=-1)
    np.testing.assert_allclose(extents(geometry, hull, position), expected, atol=1e-10)


def test_a_point_behind_the_source_has_no_extents():
    geometry = VIEWS["cone"]
    behind = geometry.source[0] * 1.1
    both = extents(geometry, [[0.0, 0, 0], behind], np.zeros(3))
    assert np.isnan(both[0]).all()
    assert np.isfinite(both[1]).all()


def test_lines_are_the_pixels_of_a_disc():
    """Between eight pairs of lines around a circle: every pixel of the disc, and few others."""
    middle, radius = np.array([12.3, 20.6]), 7.5
    along = DIRECTIONS @ middle
    outline = np.stack([along - radius, along + radius], axis=-1)[None]
    rows_reached = np.array([[5, 20, 0, 44]])
    out = np.empty((15, 4), np.int64)
    listed = np.zeros(PANEL, bool)
    for patch, row, first, end in out[: footprints.lines(outline, rows_reached, DIRECTIONS, np.zeros(1), out)]:
        assert patch == 0
        assert first < end
        listed[row, first:end] = True
    rows, columns = np.indices(PANEL)
    distance = np.hypot(rows - middle[0], columns - middle[1])
    assert listed[distance <= radius].all()
    assert not listed[distance > 1.03 * radius].any()


def test_slack_widens_and_boxes_limit_the_lines():
    point = DIRECTIONS @ [5.0, 5.0]
    outline = np.stack([point, point], axis=-1)[None]
    out = np.empty((3, 4), np.int64)
    assert footprints.lines(outline, np.array([[5, 6, 0, 44]]), DIRECTIONS, np.full(1, 1e-9), out) == 1
    assert out[0].tolist() == [0, 5, 5, 6]
    assert footprints.lines(outline, np.array([[4, 7, 0, 6]]), DIRECTIONS, np.full(1, 1.05), out) == 3
    assert out.tolist() == [[0, 4, 5, 6], [0, 5, 4, 6], [0, 6, 5, 6]]
    assert footprints.lines(outline, np.array([[5, 6, 7, 44]]), DIRECTIONS, np.full(1, 1.05), out) == 0
