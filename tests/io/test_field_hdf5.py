"""The field of view in ``reference.h5``: what is written is read."""

from __future__ import annotations

import h5py
import numpy as np

from grainmotion.io.field_hdf5 import read_field, write_field
from grainmotion.io.results import StoredReference, read_reference, write_reference
from grainmotion.model.field_of_view import FieldOfView
from grainmotion.model.geometry import Geometry
from grainmotion.model.hardening import Hardening
from grainmotion.model.view_shifts import ViewShifts
from grainmotion.model.volume import Volume

GEOMETRY = Geometry.parallel([0.0, 60.0, 120.0], (5, 7), 0.1)


def test_field_of_a_volume_is_kept(tmp_path):
    field = FieldOfView(GEOMETRY, 0.4, (0.1, -0.2), above=True)
    write_reference(tmp_path / "reference.h5", StoredReference(Volume(np.ones((3, 3, 3)), 0.1, field=field)))
    found = read_reference(tmp_path / "reference.h5").volume.field
    assert found is not None
    assert (found.radius, found.axis, found.above, found.below, found.beside) == (0.4, (0.1, -0.2), True, False, False)
    np.testing.assert_array_equal(found.geometry.vectors, GEOMETRY.vectors)
    assert (found.geometry.shape, found.geometry.beam) == ((5, 7), "parallel")


def test_shifts_of_views_are_kept(tmp_path):
    shifts = ViewShifts(np.ones((3, 2)), np.arange(3.0), np.arange(3), np.zeros(3), np.ones((3, 2)), 0.125, 46.0)
    with h5py.File(tmp_path / "field.h5", "w") as file:
        write_field(file, FieldOfView(GEOMETRY, 0.4, shifts=shifts))
        field = read_field(file)
    assert field is not None
    assert field.shifts is not None
    for name in ("values", "turns", "views", "times", "along", "pixel", "half_width"):
        np.testing.assert_array_equal(getattr(field.shifts, name), getattr(shifts, name))


def test_older_files_do_not_tell_it(tmp_path):
    with h5py.File(tmp_path / "old.h5", "w") as file:
        assert read_field(file) is None


def test_curve_that_linearised_the_scan_is_kept(tmp_path):
    curve = Hardening((1.0, 0.1, 0.02), 1.5, 0.003)
    write_reference(tmp_path / "reference.h5", StoredReference(Volume(np.ones((3, 3, 3)), 0.1, hardening=curve)))
    assert read_reference(tmp_path / "reference.h5").volume.hardening == curve
