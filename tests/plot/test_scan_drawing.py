"""The drawing of a scan: which way the sample turns, where column 0 is, which row is up."""

import numpy as np
import pytest
from matplotlib.patches import FancyArrowPatch

from grainmotion import plot
from grainmotion.model.detector_alignment import DetectorAlignment
from grainmotion.model.geometry import Geometry


def cone(angles, **panel) -> Geometry:
    alignment = DetectorAlignment(**panel)
    return Geometry.cone(angles, (20, 30), 0.1, source_to_axis=40, source_to_detector=160, panel=alignment)


def texts(ax) -> list[str]:
    return [text.get_text() for text in ax.texts]


@pytest.mark.parametrize(
    ("angles", "word", "side", "end"),
    [([0, 10, 20], "clockwise", "left", (-0.72, 0)), ([0, -10, -20], "counter-clockwise", "right", (0.72, 0))],
)
def test_the_arrow_shows_how_the_sample_turns(angles, word, side, end):
    ax = plot.geometry(cone(angles))
    assert f"sample turns {word}" in texts(ax)
    assert any(f"moves to the {side}" in text for text in texts(ax))
    (arrow,) = (p for p in ax.patches if isinstance(p, FancyArrowPatch))
    path = arrow.get_path().vertices  # from the front of the sample, where the source is
    assert path[0] == pytest.approx([0, -0.72], abs=1e-6)
    assert arrow._posA_posB[1] == pytest.approx(end, abs=1e-9)


def test_a_grain_in_front_moves_to_the_side_that_the_caption_names():
    geometry = cone([0, 10])
    front = geometry.project_points(np.array([[0.0, -0.5, 0.0]]))[:, 0, 1]
    assert front[1] < front[0]  # lower columns, which are at the left as the source sees the panel
    assert any("moves to the left" in text for text in texts(plot.geometry(geometry)))


def test_column_0_stands_where_the_geometry_has_it():
    ax = plot.geometry(cone([90, 100]))
    place = next(text.get_position() for text in ax.texts if text.get_text() == "column 0")
    corner = cone([90, 100]).pixel_positions(0)[10, 0]
    assert np.sign(place) == pytest.approx(np.sign(corner[:2]))


@pytest.mark.parametrize(("first_row", "word"), [("bottom", "lowest"), ("top", "highest")])
def test_the_caption_tells_where_row_0_is(first_row, word):
    assert any(f"row 0 of the images is the {word}" in t for t in texts(plot.geometry(cone([0], first_row=first_row))))


def test_one_view_has_no_sense_and_few_views_are_numbered():
    assert not any("sample turns" in text for text in texts(plot.geometry(cone([30]))))
    assert {"0: 0°", "1: 45°"} <= set(texts(plot.geometry(cone([0, 45]))))
    assert "to panel 160 mm" in plot.geometry(cone([0, 45])).get_title()


def test_parallel_beams_are_drawn_as_parallel():
    ax = plot.geometry(Geometry.parallel([0, 90], (20, 30), 0.1))
    rays = [line.get_xydata() for line in ax.lines if len(line.get_xdata()) == 2 and line.get_linewidth() == 0.9]
    assert len(rays) == 2
    assert rays[0][1] - rays[0][0] == pytest.approx(rays[1][1] - rays[1][0])
