"""The laboratory scanner of the tests and the package's geometry agree, and every wrong sign is seen."""

import numpy as np
import pytest

from grainmotion.model.detector_alignment import DetectorAlignment
from grainmotion.model.geometry import Geometry
from lab_scanner import Lab, ball_images

STAGE = np.array([0.0, 35.0, 140.0, 250.0])  # counter-clockwise from above


def geometry(lab, angles, **panel):
    alignment = DetectorAlignment(**{"first_row": "top", **panel})
    sizes = dict(source_to_axis=lab.source_to_axis, source_to_detector=lab.source_to_panel)
    return Geometry.cone(angles, lab.shape, lab.pixel, **sizes, panel=alignment)


def test_angles_of_the_package_grow_as_the_stage_turns_clockwise():
    lab = Lab()
    np.testing.assert_allclose(ball_images(geometry(lab, -STAGE)), lab.images(STAGE), atol=1e-9)


@pytest.mark.parametrize(
    ("lab", "panel"),
    [
        (Lab(panel_shift=(1.1, 0.0)), {"detector_offset": (1.1, 0.0)}),
        (Lab(panel_shift=(0.0, 0.7)), {"detector_offset": (0.0, -0.7)}),  # v points down where row 0 is the top
        (Lab(axis_shift=0.8), {"axis_offset": 0.8}),
        (Lab(panel_roll_deg=3.0), {"detector_tilts_deg": (0.0, 3.0, 0.0)}),
    ],
)
def test_shifts_and_rolls(lab, panel):
    np.testing.assert_allclose(ball_images(geometry(lab, -STAGE, **panel)), lab.images(STAGE), atol=1e-9)


def test_wrong_signs_are_seen():
    lab = Lab(panel_shift=(1.1, 0.7))
    right = ball_images(geometry(lab, -STAGE, detector_offset=(1.1, -0.7)))
    for wrong in (
        geometry(lab, STAGE, detector_offset=(1.1, -0.7)),
        geometry(lab, -STAGE, detector_offset=(-1.1, -0.7)),
        geometry(lab, -STAGE, detector_offset=(1.1, 0.7)),
        geometry(lab, -STAGE, detector_offset=(1.1, -0.7), first_row="bottom"),
    ):
        assert np.abs(ball_images(wrong) - right).max() > 0.1
