"""Arguments have the names of the experiment file's keys; their former names go on working, with a warning."""

from dataclasses import fields

import numpy as np
import pytest

from grainmotion import DetectorAlignment, Geometry, check_state, clump, plan, track
from grainmotion._arguments import renamed_arguments
from grainmotion.errors import InputError
from grainmotion.experiment.scan_tables import Circular
from grainmotion.model.detector_alignment import AlignmentKeys

CONE = {"source_to_axis": 40.0, "source_to_detector": 160.0}
KEYS = {
    "detector_offset": (0.3, -0.2),
    "detector_tilts_deg": (1.0, 2.0, 3.0),
    "axis_offset": 0.1,
    "axis_tilt_deg": (0.5, -0.5),
    "first_row": "top",
}


def test_a_circular_scan_takes_the_keys_of_its_table():
    assert set(AlignmentKeys.__annotations__) <= set(Circular.model_fields)
    assert [field.name for field in fields(DetectorAlignment)] == list(AlignmentKeys.__annotations__)
    panel = DetectorAlignment(**KEYS)
    for by_keys, by_record in (
        (Geometry.cone([0, 9], (5, 6), 0.1, **CONE, **KEYS), Geometry.cone([0, 9], (5, 6), 0.1, **CONE, panel=panel)),
        (Geometry.parallel([0, 9], (5, 6), 0.1, **KEYS), Geometry.parallel([0, 9], (5, 6), 0.1, panel=panel)),
    ):
        np.testing.assert_array_equal(by_keys.vectors, by_record.vectors)
    assert Geometry.parallel([0], (5, 6), 0.1, first_row="top").v[0, 2] < 0


def test_unknown_keys_name_the_nearest_one():
    with pytest.raises(InputError, match="did you mean 'first_row'"):
        Geometry.parallel([0], (5, 6), 0.1, first_rows="top")
    with pytest.raises(InputError, match="give one or the other"):
        Geometry.cone([0], (5, 6), 0.1, **CONE, panel=DetectorAlignment(), first_row="top")


def test_former_fields_of_the_alignment_warn():
    with pytest.warns(DeprecationWarning, match="offset of DetectorAlignment is now detector_offset"):
        panel = DetectorAlignment(offset=(1.0, 2.0))
    assert panel.detector_offset == (1.0, 2.0)
    with pytest.warns(DeprecationWarning, match="detector_offset"):
        assert panel.offset == (1.0, 2.0)
    with pytest.warns(DeprecationWarning, match="detector_tilts_deg"):
        assert panel.tilts_deg == (0.0, 0.0, 0.0)
    with pytest.raises(InputError, match="give detector_offset alone"):
        DetectorAlignment(offset=(1.0, 2.0), detector_offset=(1.0, 2.0))


@pytest.mark.parametrize(
    ("function", "former", "present"),
    [(track, "start", "initial"), (check_state, "start", "initial"), (plan, "views", "geometry"),
     (clump, "fit", "clump_fit")],
)  # fmt: skip
def test_former_arguments_warn_and_reach_the_present_ones(function, former, present):
    import inspect

    assert present in inspect.signature(function).parameters
    wrong = pytest.raises((TypeError, InputError), match=present if function is plan else "missing")
    with pytest.warns(DeprecationWarning, match=f"{former} of .* is now {present}"), wrong:
        function(**{former: None})  # other arguments are missing, and no geometry is None


def test_values_are_passed_on():
    @renamed_arguments(old="new")
    def function(a: int, *, new: int = 0) -> tuple[int, int]:
        return a, new

    with pytest.warns(DeprecationWarning, match="now new"):
        assert function(1, old=2) == (1, 2)
    assert function(1, new=3) == (1, 3)
