"""The field of view of the reference scan in ``reference.h5``.

Group ``field``: the dataset ``vectors`` holds views of the scan (12 numbers each, mm), its attributes say which panel
and beam they have; attributes of the group hold the sample's outline and where the sample goes on beyond the field.
Group ``shifts`` in it: how far views are from where the others predict them, as the fields of `ViewShifts`.
"""

from __future__ import annotations

import h5py

from grainmotion.model.field_of_view import FieldOfView
from grainmotion.model.geometry import Geometry
from grainmotion.model.view_shifts import ViewShifts

_BORDERS = ("above", "below", "beside")
_SHIFT_ARRAYS = {"values": "pixel", "turns": "rad", "views": "1", "times": "1", "along": "1"}
"""Arrays of `ViewShifts`, and their units."""


def write_field(file: h5py.File, field: FieldOfView | None) -> None:
    """Write the group ``field``, if what the scan saw is known."""
    if field is None:
        return
    group = file.create_group("field")
    vectors = group.create_dataset("vectors", data=field.geometry.vectors)
    vectors.attrs.update(shape=field.geometry.shape, beam=field.geometry.beam, unit="mm")
    group.attrs.update(radius=field.radius, axis=field.axis, unit="mm")
    group.attrs.update({name: getattr(field, name) for name in _BORDERS})
    if field.shifts is not None:
        shifts = group.create_group("shifts")
        for name, unit in _SHIFT_ARRAYS.items():
            shifts.create_dataset(name, data=getattr(field.shifts, name)).attrs["unit"] = unit
        shifts.attrs.update(pixel=field.shifts.pixel, half_width=field.shifts.half_width, unit="mm, pixels")


def read_field(file: h5py.File) -> FieldOfView | None:
    """Read the group ``field``; None from a file without it."""
    if "field" not in file:
        return None
    group = file["field"]
    vectors, attributes = group["vectors"], group.attrs
    rows, columns = (int(n) for n in vectors.attrs["shape"])
    geometry = Geometry(vectors[()], (rows, columns), str(vectors.attrs["beam"]))  # type: ignore[arg-type]
    x, y = (float(c) for c in attributes["axis"])
    borders = {name: bool(attributes[name]) for name in _BORDERS}
    return FieldOfView(geometry, float(attributes["radius"]), (x, y), **borders, shifts=_read_shifts(group))


def _read_shifts(group: h5py.Group) -> ViewShifts | None:
    if "shifts" not in group:
        return None
    shifts = group["shifts"]
    arrays = {name: shifts[name][()] for name in _SHIFT_ARRAYS}
    return ViewShifts(**arrays, pixel=float(shifts.attrs["pixel"]), half_width=float(shifts.attrs["half_width"]))
