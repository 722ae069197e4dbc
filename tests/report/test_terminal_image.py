"""The radiograph in the terminal shows the same up, axis and sense of rotation as the picture."""

import numpy as np

from grainmotion.experiment.inspection import FirstViews
from grainmotion.model.detector_alignment import DetectorAlignment
from grainmotion.model.geometry import Geometry
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.report.terminal_image import terminal_radiograph
from lab_scanner import Lab

LAB = Lab()
TOP_BALL = ((0.0, 0.0, 2.0, 0.8, 1.0),)  # above the middle, on the axis


def text(first_row="top", offset=0.0):
    panel = DetectorAlignment(first_row=first_row, axis_offset=offset)
    angles = np.array([0.0, 15.0, 40.0])
    sizes = dict(source_to_axis=LAB.source_to_axis, source_to_detector=LAB.source_to_panel)
    geometry = Geometry.cone(angles, LAB.shape, LAB.pixel, **sizes, panel=panel)
    images = np.stack([LAB.image(0.0, TOP_BALL)] * 3)
    if first_row == "bottom":
        images = images[:, ::-1]
    first = FirstViews("scan", Scan(images, geometry), (0, 1, 2))
    return terminal_radiograph(first, Volume.zeros((56, 64, 64), 0.1), width=64)


def test_the_top_of_the_sample_is_drawn_at_the_top_whichever_row_comes_first():
    for first_row in ("top", "bottom"):
        lines = text(first_row).splitlines()[1:-1]
        dense = [k for k, line in enumerate(lines) if "@" in line]
        assert max(dense) < len(lines) / 2


def test_the_axis_is_drawn_where_its_shadow_falls():
    columns = [line.index("|") for line in text(offset=1.0).splitlines()[1:-1] if "|" in line]
    assert np.ptp(columns) == 0
    assert columns[0] in (41, 42)  # 31.5 + 1.0 mm times the magnification 4 over the pixel of 0.4 mm


def test_the_sense_of_rotation_is_told():
    assert "<-- o moves left" in text()  # angles grow as the stage turns clockwise
