"""The field of view of the reference scan in ``reference.h5``.

Group ``field``: the dataset ``vectors`` holds views of the scan (12 numbers each, mm), its attributes say which panel
and beam they have; attributes of the group hold the sample's outline and where the sample goes on beyond the field.
"""

from __future__ import annotations

import h5py

from grainmotion.model.field_of_view import FieldOfView
from grainmotion.model.geometry import Geometry

_BORDERS = ("above", "below", "beside")


def write_field(file: h5py.File, field: FieldOfView | None) -> None:
    """Write the group ``field``, if what the scan saw is known."""
    if field is None:
        return
    group = file.create_group("field")
    vectors = group.create_dataset("vectors", data=field.geometry.vectors)
    vectors.attrs.update(shape=field.geometry.shape, beam=field.geometry.beam, unit="mm")
    group.attrs.update(radius=field.radius, axis=field.axis, unit="mm")
    group.attrs.update({name: getattr(field, name) for name in _BORDERS})


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
    return FieldOfView(geometry, float(attributes["radius"]), (x, y), **borders)
