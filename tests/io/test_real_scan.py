"""A piece of a real synchrotron scan, as a series of files and as NXtomo: angles, counts and the place of the axis."""

from pathlib import Path

import numpy as np
import pint
import pytest
import tifffile
from nxtomo.application.nxtomo import NXtomo

from read_experiment_scan import reference_of

DATA = Path(__file__).parent / "savu_data"
AXIS = 86.0  # found by matching views half a turn apart, to half a column
PIXEL = 0.004  # mm; not known, any serves
UNITS = pint.get_application_registry()
STAGE = [-88.2, -28.2, 31.8, 91.8]
SERIES = f"""
[reference]
radiographs = "{DATA}/raw_*.tiff"
flats = "{DATA}/flat_00001.tiff"
darks = "{DATA}/dark_00001.tiff"
[reference.geometry]
beam = "parallel"
pixel_size = {PIXEL}
first_row = "top"
first = -88.2
step = 60
detector_offset = [{-(AXIS - 79.5) * PIXEL}, 0]
"""


def as_nxtomo(tmp_path, column):
    """The same frames in a file of the ESRF's library."""
    names = ("dark_00001", "flat_00001", "raw_00000", "raw_00030", "raw_00060", "raw_00090")
    scan = NXtomo()
    detector = scan.instrument.detector
    detector.data = np.stack([np.round(tifffile.imread(DATA / f"{n}.tiff")).astype(np.uint16) for n in names])
    detector.image_key_control = np.array([2, 1, 0, 0, 0, 0])
    detector.x_pixel_size = detector.y_pixel_size = PIXEL * 1e-3 * UNITS.meter
    detector.x_rotation_axis_pixel_position = column
    detector.set_transformation_from_lr_flipped(False)
    detector.set_transformation_from_ud_flipped(False)
    scan.instrument.source.type = "Synchrotron X-ray Source"
    scan.sample.rotation_angle = np.array([STAGE[0], STAGE[0], *STAGE]) * UNITS.degree
    scan.save(str(tmp_path / "scan.nx"), "entry0000")
    return '[reference]\nradiographs = "scan.nx"\n'


def mirrored_misfit(source, axis):
    """Median difference between the first view and the last, mirrored at a column, which is half a turn later."""
    images = source.read()[0].line_integrals
    columns = np.arange(40, 130)
    seen = np.stack([np.interp(2 * axis - columns, np.arange(images.shape[2]), row) for row in images[-1]])
    return float(np.median(np.abs(images[0][:, columns] - seen)))


@pytest.mark.parametrize("kind", ["series", "NXtomo", "NXtomo, from the middle"])
def test_the_axis_is_where_views_half_a_turn_apart_are_mirrored(tmp_path, kind):
    column = AXIS if kind == "NXtomo" else AXIS - 79.5
    source = reference_of(tmp_path, SERIES if kind == "series" else as_nxtomo(tmp_path, column))
    assert source.geometry.beam == "parallel"
    azimuths = (source.geometry.azimuths_deg + 180) % 360 - 180
    np.testing.assert_allclose(azimuths, STAGE, atol=1e-5)
    axis = source.geometry.project_points([[0, 0, 0], [0, 0, 0.02]])
    np.testing.assert_allclose(axis[:, 0, 1], AXIS, atol=1e-6)
    np.testing.assert_allclose(axis[:, 1, 0] - axis[:, 0, 0], -0.02 / PIXEL, atol=1e-6)  # row 0 is the top
    there = mirrored_misfit(source, axis[0, 0, 1])
    for other in (159 - AXIS, AXIS - 2, AXIS + 2):
        assert mirrored_misfit(source, other) > 1.5 * there
