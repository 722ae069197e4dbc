"""Geometry tables of circular scans: angles, settings that states inherit, misalignment, selected views."""

import numpy as np
import pytest
from experiment_inputs import inputs_of

from grainmotion.errors import InputError
from grainmotion.model.detector_alignment import DetectorAlignment
from grainmotion.model.geometry import Geometry
from tiny_experiment import PANEL, geometry

CIRCULAR = """
[reference]
radiographs = "all.npy"
kind = "line-integrals"
[reference.geometry]
{beam}
pixel_size = 0.4
{angles}
[[states]]
name = "one"
radiographs = "all.npy"
views = [0, 3]
[states.geometry]
angles_deg = [5, 6, 7, 8]
"""
CONE = 'source_to_axis = 50\nsource_to_detector = 200\nfirst_row = "bottom"'


class TestCircular:
    @pytest.fixture(autouse=True)
    def images(self, tmp_path):
        """Four radiographs and a file of their angles."""
        np.save(tmp_path / "all.npy", np.ones((4, *PANEL), np.float32))
        (tmp_path / "angles.txt").write_text("# degrees\n0\n30.0\n60 # stage\n\n90\n")

    @pytest.mark.parametrize(
        "angles",
        [
            "angles_deg = [0, 30, 60, 90]",
            'angles_deg = "angles.txt"',
            "angles_deg = { first = 0, last = 90, count = 4 }",
            "first = 0\nlast = 90\ncount = 4",
        ],
    )
    def test_angles_as_list_file_or_range(self, tmp_path, angles):
        inputs = inputs_of(tmp_path, CIRCULAR.format(beam=CONE, angles=angles))
        assert inputs.reference is not None
        expected = geometry([0, 30, 60, 90]).vectors
        np.testing.assert_allclose(inputs.reference.geometry.vectors, expected)

    def test_state_inherits_from_the_reference_and_selects_views(self, tmp_path):
        inputs = inputs_of(tmp_path, CIRCULAR.format(beam=CONE, angles="first=0\nlast=90\ncount=4"))
        np.testing.assert_allclose(inputs.states[0].geometry.vectors, geometry([5, 8]).vectors)
        scan, _ = inputs.states[0].read()
        assert len(scan) == 2

    def test_detector_and_axis_misalignment(self, tmp_path):
        extra = "detector_offset = [0.3, -0.1]\ndetector_tilts_deg = [1, 2, 3]\naxis_offset = 0.2\n"
        extra += 'axis_tilt_deg = [0.5, 0]\nfirst_row = "top"\nbeam = "parallel"'
        toml = CIRCULAR.format(beam=extra, angles="angles_deg = [0, 30, 60, 90]")
        inputs = inputs_of(tmp_path, toml)
        panel = DetectorAlignment((0.3, -0.1), (1, 2, 3), 0.2, (0.5, 0), "top")
        expected = Geometry.parallel([0, 30, 60, 90], PANEL, 0.4, panel=panel)
        assert inputs.reference is not None
        np.testing.assert_allclose(inputs.reference.geometry.vectors, expected.vectors)
        assert inputs.states[0].geometry.beam == "parallel"

    @pytest.mark.parametrize("where", ["reference", "states.one"])
    def test_first_row_has_no_silent_default(self, tmp_path, where):
        toml = CIRCULAR.format(beam=CONE, angles="angles_deg = [0, 30, 60, 90]")
        if where == "states.one":  # a reference from CSV has no table that the state could inherit from
            start, end = toml.index("[reference.geometry]"), toml.index("[[states]]")
            table = toml[start:end].replace("[reference.geometry]\n", "").replace("angles_deg = [0, 30, 60, 90]", "")
            toml = toml[:start] + 'geometry = "views.csv"\n' + toml[end:] + table
        inputs_missing = toml.replace('first_row = "bottom"', "")
        assert inputs_missing != toml
        with pytest.raises(InputError, match=rf"{where}.geometry.first_row: it is missing.*\"top\".*\"bottom\"") as e:
            inputs_of(tmp_path, inputs_missing)
        assert "also" not in str(e.value)  # the states' tables, which inherit it, are not blamed as well

    def test_state_inherits_first_row(self, tmp_path):
        toml = CIRCULAR.format(beam=CONE.replace("bottom", "top"), angles="angles_deg = [0, 30, 60, 90]")
        state = inputs_of(tmp_path, toml).states[0]
        assert np.all(state.geometry.v[:, 2] < 0)

    def test_default_grid_covers_the_field_of_view(self, tmp_path):
        grid = inputs_of(tmp_path, CIRCULAR.format(beam=CONE, angles="first=0\nlast=90\ncount=4")).grid
        assert grid.shape == (28, 36, 36)
        assert grid.voxel_size == pytest.approx(0.1)

    @pytest.mark.parametrize(
        ("angles", "message"),
        [
            ("angles_deg = [0, 30, 60]", "3 views, but all.npy .* holds 4 radiographs"),
            ('angles_deg = "none.txt"', "none.txt.*no such file"),
            ("angles_deg = [0, 30, 60, 90]\nfirst = 0", "angles_deg and first are both given"),
            ("first = 0\nlast = 90", "reference.geometry.count: it is missing beside first, last"),
            ("angles_deg = [0, 30, 60, nan]", "reference.geometry.angles_deg"),
        ],
    )
    def test_bad_angles_are_refused(self, tmp_path, angles, message):
        with pytest.raises(InputError, match=message):
            inputs_of(tmp_path, CIRCULAR.format(beam=CONE, angles=angles))

    def test_bad_line_in_a_file_of_angles_is_refused(self, tmp_path):
        (tmp_path / "angles.txt").write_text("0\n30\nsixty\n90\n")
        with pytest.raises(InputError, match=r"angles\.txt: line 3 is 'sixty'"):
            inputs_of(tmp_path, CIRCULAR.format(beam=CONE, angles='angles_deg = "angles.txt"'))

    def test_geometry_may_list_the_selected_views_only(self, tmp_path):
        toml = CIRCULAR.format(beam=CONE, angles="first=0\nlast=90\ncount=4")
        inputs = inputs_of(tmp_path, toml.replace("[5, 6, 7, 8]", "[5, 8]"))
        np.testing.assert_allclose(inputs.states[0].geometry.vectors, geometry([5, 8]).vectors)
        with pytest.raises(InputError, match=r"3 views, but .* 4 radiographs, of which 2 are chosen"):
            inputs_of(tmp_path, toml.replace("[5, 6, 7, 8]", "[5, 8, 9]"))

    @pytest.mark.parametrize(("views", "count"), [('"::2"', 2), ('"1:"', 3), ("[-1]", 1), ('"2"', 1)])
    def test_views_as_slice_or_list(self, tmp_path, views, count):
        toml = CIRCULAR.format(beam=CONE, angles="first=0\nlast=90\ncount=4")
        state = inputs_of(tmp_path, toml.replace("[0, 3]", views)).states[0]
        assert len(state.geometry) == count

    @pytest.mark.parametrize("views", ['"a:b"', "[9]", '"9"', '"4:"', "[]"])
    def test_bad_views_are_refused(self, tmp_path, views):
        toml = CIRCULAR.format(beam=CONE, angles="first=0\nlast=90\ncount=4")
        with pytest.raises(InputError, match=r"states\.one\.views"):
            inputs_of(tmp_path, toml.replace("[0, 3]", views))
